"""Rendered images of printed boards of all kinds through a fisheye and a mirror, with the true points."""

from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from omnisight.models import model_class
from omnisight.targets.boards.aprilgrid import AprilGrid
from omnisight.targets.boards.aruco_grid import ArucoGrid
from omnisight.targets.boards.charuco import Charuco
from omnisight.targets.boards.circles import CircleGrid
from omnisight.targets.printing.drawing import Disc

SIZE = (800, 640)
FINE = 4  # samples per pixel and axis
CAMERAS = {
    "fisheye": model_class("equidistant")(240.0, 240.0, 401.3, 322.8),
    "mirror": model_class("unified")(330.0, 330.0, 401.3, 322.8, 0.95),
}
CHARUCO = Charuco(9, 6, square=0.024, marker=0.018)
APRIL = AprilGrid(5, 4, tag=0.024, spacing=0.3)
ARUCO_GRID = ArucoGrid(5, 4, marker=0.024, separation=0.006, dictionary="DICT_6X6_50")
CIRCLES = CircleGrid(4, 11, spacing=0.02, diameter=0.02)


@cache
def rays(lens):
    at = (np.arange(FINE) + 0.5) / FINE - 0.5
    u, v = (np.add.outer(np.arange(n), at).ravel() for n in SIZE)
    bearings, valid = CAMERAS[lens].unproject(np.stack(np.meshgrid(u, v), axis=-1))
    return np.where(valid[..., None], bearings, np.nan).astype(np.float32)


@cache
def texture(board, scale=25000 / 3):
    """Paint the board at `scale` texels per metre, chosen so that the edges that are measured fall between texels."""
    left, top, right, bottom = board.extent
    pad = board.quiet_zone
    left, top = left - pad, top - pad
    paper = np.full([round((b - a + pad) * scale) for a, b in ((top, bottom), (left, right))], 215, np.uint8)
    for shape in board.drawing():
        tone = 215 if shape.white else 35
        if isinstance(shape, Disc):
            at, radius = (np.array(shape.centre) - (left, top)) * scale - 0.5, shape.radius * scale
            (u0, v0), (u1, v1) = (np.floor(at - radius).astype(int), np.ceil(at + radius).astype(int) + 1)
            v, u = np.mgrid[v0:v1, u0:u1]
            paper[v0:v1, u0:u1][np.hypot(u - at[0], v - at[1]) < radius] = tone
        else:
            u, v = np.rint((np.array(shape.corners) - (left, top)) * scale).astype(int).T
            inside = np.zeros((np.ptp(v), np.ptp(u)), bool)
            # All sides run along the axes: every upright one flips what is to its right.
            for a, b, c in zip(u - u.min(), v - v.min(), np.roll(v, -1) - v.min(), strict=True):
                inside[min(b, c) : max(b, c), a:] ^= True
            paper[v.min() : v.max(), u.min() : u.max()][inside] = tone
    return paper, (left, top), scale


def pose(board, angle, *, roll=20.0, distance=0.17, tilt=(20, -15), azimuth=30.0):
    """Face the board from `angle` degrees off the axis, then tilt it; board to camera."""
    facing = Rotation.from_euler("ZYZ", [azimuth, angle, roll - azimuth], degrees=True)
    middle = np.array(board.points).mean(axis=0)
    rotation = (facing * Rotation.from_euler("XY", tilt, degrees=True)).as_matrix()
    return rotation, facing.apply([0, 0, distance]) - rotation @ middle


def projector(lens, placed):
    rotation, position = placed
    return lambda points: CAMERAS[lens].project(points @ rotation.T + position)[0]


def render(board, lens, placed, *, noise=0.02, mirrored=False, seed=0):
    """Return the image and the true places of the board's points."""
    paper, (left, top), scale = texture(board)
    rotation, position = (a.astype(np.float32) for a in placed)
    # Rays are only traced where the paper is seen.
    y, x = np.mgrid[0 : paper.shape[0] : 25j, 0 : paper.shape[1] : 25j].reshape(2, -1) / scale
    seen = projector(lens, placed)(np.stack([x + left, y + top, 0 * x], axis=1))
    low, high = np.clip([np.nanmin(seen, axis=0) - 9, np.nanmax(seen, axis=0) + 9], 0, SIZE).astype(int)
    part = (slice(low[1] * FINE, high[1] * FINE), slice(low[0] * FINE, high[0] * FINE))
    seen, start = rays(lens)[part] @ rotation, -position @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -start[2] / seen[..., 2]
        x, y = (start[k] + distance * seen[..., k] for k in (0, 1))
        hit = distance > 0
    u, v = (np.where(hit, (a - b) * scale - 0.5, -1e6).astype(np.float32) for a, b in ((x, left), (y, top)))
    fine = cv2.remap(paper, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=120)
    image = np.full(SIZE[::-1], 120, np.float32)
    shown = fine.reshape(high[1] - low[1], FINE, high[0] - low[0], FINE).mean(axis=(1, 3))
    image[low[1] : high[1], low[0] : high[0]] = shown
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    image += np.random.default_rng(seed).normal(0, 255 * noise, image.shape)
    image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    truth = projector(lens, placed)(board.points)
    if mirrored:
        return np.ascontiguousarray(image[:, ::-1]), np.stack([SIZE[0] - 1 - truth[:, 0], truth[:, 1]], axis=1)
    return image, truth
