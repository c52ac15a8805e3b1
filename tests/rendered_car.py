"""A car with four fisheyes over a textured ground, rendered."""

from functools import cache

import cv2
import numpy as np

import omnisight as om
from omnisight.calibration.ground_layout import GroundLayout
from omnisight.simulation import Renderer, Scene, Texture, rectangle
from omnisight.simulation.example_rigs import surround_car

RIG = surround_car(480)
# Half the sides of the textured ground, metres, and its texels per metre.
HALF = (6.0, 7.0)
TEXELS_PER_M = 40
# A ring of squares around the car, two wide.
SQUARE = 0.5
COLUMNS, ROWS, RING = 12, 20, 4


def squares():
    """Return the rows of the layout."""
    return tuple(
        "".join(
            (" " if RING <= i < ROWS - RING and RING <= j < COLUMNS - RING else "#."[(i + j) % 2])
            for j in range(COLUMNS)
        )
        for i in range(ROWS)
    )


LAYOUT = GroundLayout(SQUARE, squares())


@cache
def ground_texture(kind):
    """Return the ground (H, W, 3) from above, forward up: smooth noise, or the squares of the layout."""
    size = round(2 * HALF[0] * TEXELS_PER_M), round(2 * HALF[1] * TEXELS_PER_M)
    if kind == "noise":
        noise = np.random.default_rng(3).uniform(30, 220, (size[1] // 16, size[0] // 16, 3)).astype(np.float32)
        return cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC).clip(0, 255).astype(np.uint8)
    image = np.full((size[1], size[0], 3), 128, np.uint8)
    side = round(SQUARE * TEXELS_PER_M)
    left, top = size[0] // 2 - COLUMNS * side // 2, size[1] // 2 - ROWS * side // 2
    for i, row in enumerate(LAYOUT.squares):
        for j, square in enumerate(row):
            at = slice(top + i * side, top + (i + 1) * side), slice(left + j * side, left + (j + 1) * side)
            image[at] = {"#": 40, ".": 215, " ": 128}[square]
    return image


@cache
def images(kind="noise"):
    """Return the images of the four cameras, by name."""
    x, z = HALF
    floor = rectangle((-x, 0, z), (2 * x, 0, 0), (0, 0, -2 * z), Texture(ground_texture(kind)), "ground")
    scene = Scene((floor,), sky=Texture.plain((90, 90, 90)))
    return {
        name: Renderer(camera, pose.inverse(), scene, samples=3)().image
        for name, camera, pose in zip(RIG.names, RIG.cameras, RIG.sensor_from_rig, strict=True)
    }


def texture_at(view):
    """Return the ground texture (H, W, 3) at the pixels of a view, as float."""
    width, height = view.size
    ground = view.ground(np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1))
    at = np.stack([ground[..., 0] + HALF[0], HALF[1] - ground[..., 1]], -1) * TEXELS_PER_M - 0.5
    return cv2.remap(ground_texture("noise"), at.astype(np.float32), None, cv2.INTER_LINEAR).astype(float)


def write(folder, kind="noise", rig=RIG):
    """Write the images and the rig, and return the paths of the images."""
    paths = []
    for name, image in images(kind).items():
        paths.append(folder / f"{name}.png")
        om.write_image(paths[-1], image)
    om.save(rig, folder / "rig.json")
    return paths
