"""Objects of streets made of primitives; positions are centres of the base."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.procedural_textures import decor, materials, outdoors
from omnisight.simulation.solids import Solid, box, cylinder, ellipsoid
from omnisight.simulation.texture import Texture

Point = tuple[float, float, float]
Rng = np.random.Generator

CAR_PAINTS: tuple[tuple[int, int, int], ...] = (
    *((150, 34, 36), (36, 62, 110), (204, 206, 208), (44, 46, 50), (88, 112, 96), (196, 160, 70)),
)


def tree(foot: Point, leaf: Texture, bark: Texture, name: str, rng: Rng, tall: float = 5.5) -> list[Solid]:
    """Return a tree: a trunk and a crown of leafy ellipsoids."""
    base = np.array(foot)
    fork = base + np.array((0, -0.45 * tall, 0))
    solids = [cylinder(fork, base, 0.025 * tall, bark, name)]
    for i in range(14):
        turn, height = 2.4 * i, 0.5 + 0.5 * (i + 0.5) / 14
        radius = 0.24 * tall * np.sqrt(max(1 - ((height - 0.68) / 0.36) ** 2, 0.05)) * rng.uniform(0.6, 1.0)
        centre = base + np.array((radius * np.cos(turn), -height * tall, radius * np.sin(turn)))
        size = tall * rng.uniform(0.1, 0.16)
        blob = ellipsoid((0, 0, 0), (size, 0.8 * size, size), leaf, name)
        solids.append(blob.moved(Pose(exp(rng.normal(0, 0.5, 3)), centre)))
        if i % 3 == 0:
            solids.append(cylinder(fork, centre, 0.008 * tall, bark, name))
    return solids


def lamp_post(foot: Point, towards: int, name: str) -> list[Solid]:
    """Return a street lamp whose arm reaches along x."""
    x, y, z = foot
    iron = Texture.plain((70, 78, 76))
    top = y - 5.2
    return [
        cylinder((x, y - 0.5, z), foot, 0.1, iron, name),
        cylinder((x, top, z), (x, y - 0.5, z), 0.055, iron, name),
        cylinder((x, top, z), (x + 1.1 * towards, top - 0.15, z), 0.04, iron, name),
        ellipsoid((x + 1.2 * towards, top - 0.1, z), (0.28, 0.09, 0.14), Texture.plain((236, 232, 214)), name),
    ]


def car(foot: Point, name: str, rng: Rng) -> list[Solid]:
    """Return a parked car along z."""
    paint = CAR_PAINTS[int(rng.integers(len(CAR_PAINTS)))]
    x, y, z = foot
    body, cabin = (Texture(outdoors.car_side(rng, paint, cabin=c)) for c in (False, True))
    ends = {"near": Texture(outdoors.car_end(paint, back=True)), "far": Texture(outdoors.car_end(paint, back=False))}
    flank, glass = {"left": body, "right": body, **ends}, Texture.plain((58, 68, 78))
    metal = Texture(materials.to_8bit(materials.shaded(paint, materials.fractal_noise(rng, (64, 128), 32, 3.0))))
    sides = {"left": cabin, "right": cabin, "near": glass, "far": glass}
    solids = [
        box((x - 0.85, y - 0.85, z - 2.1), (x + 0.85, y - 0.28, z + 2.1), {**flank, "other": metal}, name),
        box((x - 0.74, y - 1.42, z - 1.35), (x + 0.74, y - 0.85, z + 0.75), {**sides, "other": metal}, name),
    ]
    tyre, hub = Texture.plain((34, 34, 36)), np.full((64, 64, 3), (34, 34, 36), np.uint8)
    _disc(hub, 20, (168, 170, 174))
    _disc(hub, 6, (60, 60, 64))
    for side in (-0.87, 0.67):
        for along in (-1.35, 1.3):
            start, end = (x + side, y - 0.32, z + along), (x + side + 0.2, y - 0.32, z + along)
            solids.append(cylinder(start, end, 0.32, {"side": tyre, "other": Texture(hub)}, name))
    return solids


def poster_column(foot: Point, rng: Rng) -> list[Solid]:
    """Return a round column with posters on it."""
    x, y, z = foot
    face = np.full((materials.px(2.4), materials.px(3.8), 3), (214, 208, 190), np.uint8)
    decor.poster(face, (0.1, 0.4, 0.9, 1.2))
    decor.abstract(face, (1.2, 0.5, 0.8, 1.0))
    decor.landscape(face, (2.2, 0.6, 1.3, 0.85), rng)
    decor.stripes(face, (1.2, 1.6, 2.2, 0.5))
    green = Texture.plain((58, 84, 66))
    return [
        cylinder((x, y - 2.5, z), (x, y - 0.1, z), 0.6, {"side": Texture(face), "other": green}, "poster column"),
        cylinder((x, y - 2.65, z), (x, y - 2.5, z), 0.7, green, "poster column"),
        ellipsoid((x, y - 2.65, z), (0.6, 0.35, 0.6), green, "poster column"),
        cylinder((x, y - 0.1, z), foot, 0.68, green, "poster column"),
    ]


def bench(foot: Point, rng: Rng) -> list[Solid]:
    """Return a bench along z with its back away from the road."""
    x, y, z = foot
    oak, iron = Texture(materials.wood(rng, 1.6, 0.15, (150, 104, 62))), Texture.plain((52, 54, 56))
    away = np.sign(x)
    solids: list[Solid] = []
    for i in range(3):
        across = x + away * (0.15 * i - 0.15)
        solids.append(box((across - 0.06, y - 0.46, z - 0.8), (across + 0.06, y - 0.42, z + 0.8), oak, "bench"))
    for i in range(2):
        back = x + away * 0.26
        top = y - 0.9 + 0.2 * i
        solids.append(box((back - 0.02, top, z - 0.8), (back + 0.02, top + 0.13, z + 0.8), oak, "bench"))
    for end in (-0.65, 0.65):
        solids.append(box((x - 0.2, y - 0.42, z + end - 0.03), (x + 0.2, y, z + end + 0.03), iron, "bench"))
        back = x + away * 0.23
        solids.append(box((back - 0.02, y - 0.88, z + end - 0.03), (back + 0.02, y, z + end + 0.03), iron, "bench"))
    return solids


def road_sign(foot: Point, words: str, name: str) -> list[Solid]:
    """Return a round sign that faces along -z."""
    import cv2

    x, y, z = foot
    face = np.full((128, 128, 3), (236, 236, 232), np.uint8)
    cv2.circle(face, (64, 64), 56, (196, 30, 36), 14, cv2.LINE_AA)
    cv2.putText(face, words, (30, 80), cv2.FONT_HERSHEY_DUPLEX, 1.6, (24, 24, 26), 4, cv2.LINE_AA)
    gray = Texture.plain((140, 142, 146))
    return [
        cylinder((x, y - 2.6, z), foot, 0.03, gray, name),
        box((x - 0.3, y - 2.75, z - 0.05), (x + 0.3, y - 2.15, z - 0.03), {"near": Texture(face), "other": gray}, name),
    ]


def _disc(image: materials.Bytes, radius: int, colour: tuple[int, int, int]) -> None:
    import cv2

    middle = image.shape[0] // 2
    cv2.circle(image, (middle, middle), radius, colour, -1, cv2.LINE_AA)
