"""Furniture made of primitives; positions are low corners, or centres of the base."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.procedural_textures import decor, materials
from omnisight.simulation.solids import Solid, box, cylinder, ellipsoid
from omnisight.simulation.texture import Texture

Point = tuple[float, float, float]
Rng = np.random.Generator


def table(low: Point, high: Point, rng: Rng) -> list[Solid]:
    """Return a coffee table with books, a cup and fruit on it."""
    oak = Texture(materials.wood(rng, high[0] - low[0], high[2] - low[2], (176, 132, 88)))
    top = low[1] + 0.04
    solids = [box(low, (high[0], top, high[2]), oak, "table")]
    for x in (low[0] + 0.03, high[0] - 0.08):
        for z in (low[2] + 0.03, high[2] - 0.08):
            solids.append(box((x, top, z), (x + 0.05, high[1], z + 0.05), oak, "table"))
    at = np.array((low[0] + 0.25, low[1], (low[2] + high[2]) / 2))
    for i, side in enumerate(((0.24, 0.17), (0.21, 0.15), (0.18, 0.13))):
        cover = np.full((64, 96, 3), decor.BOOKS[3 * i + 1], np.uint8)
        cover[8:-8, 10:-10] = decor.BOOKS[3 * i]
        cover[20:28, 20:-20] = (230, 222, 204)
        pages = Texture.plain((226, 220, 204))
        book = box(
            (-side[0] / 2, -0.03, -side[1] / 2),
            (side[0] / 2, 0, side[1] / 2),
            {"top": Texture(cover), "near": Texture.plain(decor.BOOKS[3 * i + 1]), "other": pages},
            "books",
        )
        solids.append(book.moved(Pose(exp(np.array((0, 0.5 * i - 0.3, 0))), at + np.array((0, -0.03 * i, 0)))))
    cup = (high[0] - 0.2, low[1], low[2] + 0.2)
    solids.append(cylinder((cup[0], cup[1] - 0.09, cup[2]), cup, 0.04, Texture.plain((226, 228, 224)), "cup"))
    for i in range(4):
        place = (high[0] - 0.22 + 0.07 * (i % 2), low[1] - 0.037, high[2] - 0.2 + 0.07 * (i // 2))
        peel = materials.to_8bit(materials.shaded((206, 116, 40), materials.fractal_noise(rng, (64, 128), 16, 8.0)))
        solids.append(ellipsoid(place, 0.037, Texture(peel), "fruit"))
    return solids


def armchair(low: Point, rng: Rng) -> list[Solid]:
    """Return an armchair of 0.85 x 0.9 x 0.8 m that faces -z."""
    x, y, z = low
    cloth = Texture(materials.fabric(rng, 0.8, 0.8, (64, 92, 104)))
    cushion = Texture(materials.fabric(rng, 0.5, 0.5, (206, 150, 70)))
    parts = [
        ((x + 0.12, y + 0.45, z), (x + 0.73, y + 0.62, z + 0.65), cloth),
        ((x, y + 0.28, z), (x + 0.14, y + 0.85, z + 0.75), cloth),
        ((x + 0.71, y + 0.28, z), (x + 0.85, y + 0.85, z + 0.75), cloth),
        ((x + 0.02, y + 0.62, z + 0.02), (x + 0.83, y + 0.85, z + 0.75), cloth),
        ((x, y, z + 0.6), (x + 0.85, y + 0.85, z + 0.8), cloth),
        ((x + 0.25, y + 0.12, z + 0.48), (x + 0.65, y + 0.46, z + 0.6), cushion),
    ]
    return [box(start, end, texture, "armchair") for start, end, texture in parts]


def chair(low: Point, rng: Rng) -> list[Solid]:
    """Return a wooden chair of 0.45 x 1 x 0.45 m that faces -x."""
    x, y, z = low
    birch = Texture(materials.wood(rng, 0.5, 0.5, (196, 160, 112)))
    solids = [box((x, y + 0.54, z), (x + 0.45, y + 0.58, z + 0.45), birch, "chair")]
    for a, b, tall in ((0.0, 0.0, 0.58), (0.0, 0.41, 0.58), (0.41, 0.0, 0.0), (0.41, 0.41, 0.0)):
        solids.append(box((x + a, y + tall, z + b), (x + a + 0.04, y + 1.0, z + b + 0.04), birch, "chair"))
    for i in range(3):
        top = y + 0.04 + 0.16 * i
        solids.append(box((x + 0.42, top, z + 0.04), (x + 0.44, top + 0.09, z + 0.41), birch, "chair"))
    return solids


def floor_lamp(foot: Point) -> list[Solid]:
    """Return a floor lamp with a glowing shade."""
    x, y, z = foot
    steel = Texture.plain((90, 90, 94))
    return [
        cylinder((x, y - 0.03, z), (x, y, z), 0.15, steel, "floor lamp"),
        cylinder((x, y - 1.6, z), (x, y - 0.03, z), 0.015, steel, "floor lamp"),
        cylinder((x, y - 1.75, z), (x, y - 1.4, z), 0.2, Texture.plain((250, 226, 178)), "floor lamp", glow=0.9),
    ]


def potted_plant(foot: Point, rng: Rng) -> list[Solid]:
    """Return a tall potted plant."""
    x, y, z = foot
    clay = Texture(materials.to_8bit(materials.shaded((170, 92, 62), materials.fractal_noise(rng, (96, 192), 32, 5.0))))
    solids = [cylinder((x, y - 0.38, z), (x, y, z), 0.19, clay, "plant")]
    leaf = Texture(materials.leaves(rng, (66, 110, 58), 256))
    for i in range(16):
        turn, tall = 2.4 * i, 0.5 + 0.055 * i
        reach = 0.3 - 0.012 * i
        tip = np.array((x + reach * np.cos(turn), y - 0.38 - tall, z + reach * np.sin(turn)))
        solids.append(cylinder((x, y - 0.38, z), tip, 0.006, Texture.plain((70, 96, 50)), "plant"))
        blade = ellipsoid((0, 0, 0), (0.16, 0.012, 0.065), leaf, "plant")
        solids.append(blade.moved(Pose(exp(np.array((0, -turn, 0))) @ exp(np.array((0, 0, 0.35))), tip)))
    return solids


def sideboard_objects(low: Point, rng: Rng) -> list[Solid]:
    """Return a row of a potted plant, a clock and a vase."""
    x, y, z = low
    clay, leaf = Texture.plain((190, 104, 70)), Texture(materials.leaves(rng, (84, 128, 70), 256))
    solids = [cylinder((x + 0.3, y - 0.15, z), (x + 0.3, y, z), 0.09, clay, "herbs")]
    for _ in range(9):
        away = rng.normal(0, (0.07, 0.05, 0.05))
        solids.append(ellipsoid(np.array((x + 0.3, y - 0.24, z)) + away, (0.07, 0.05, 0.07), leaf, "herbs"))
    glaze = Texture(
        materials.to_8bit(materials.shaded((70, 110, 140), materials.fractal_noise(rng, (96, 192), 24, 9.0)))
    )
    solids.append(ellipsoid((x + 1.15, y - 0.12, z), (0.1, 0.12, 0.1), glaze, "vase"))
    solids.append(cylinder((x + 1.15, y - 0.3, z), (x + 1.15, y - 0.2, z), 0.035, glaze, "vase"))
    face = np.full((72, 96, 3), (60, 48, 40), np.uint8)
    face[8:-8, 8:-8] = (236, 232, 218)
    face[18:38, 46:50] = face[34:38, 46:70] = (30, 30, 32)
    wooden = Texture.plain((84, 58, 40))
    solids.append(
        box((x + 0.7, y - 0.15, z), (x + 0.9, y, z + 0.08), {"near": Texture(face), "other": wooden}, "clock")
    )
    return solids


def parcels(foot: Point, rng: Rng) -> list[Solid]:
    """Return a stack of cardboard boxes."""
    solids: list[Solid] = []
    for i, (wide, tall) in enumerate(((0.5, 0.36), (0.4, 0.3), (0.26, 0.2))):
        card = materials.shaded(
            (178, 138, 96),
            materials.fractal_noise(rng, (96, 128), 32, 4.0) + materials.smooth_noise(rng, (96, 128), (1, 40), 3.0),
        )
        card[:, 58:70] = (206, 178, 132)
        card[60:80, 84:118] = (238, 236, 228)
        card[64:66, 88:112] = card[70:72, 88:104] = (40, 40, 44)
        parcel = box(
            (-wide / 2, -tall, -wide / 2), (wide / 2, 0, wide / 2), Texture(materials.to_8bit(card)), "parcels"
        )
        rise = (0.0, 0.36, 0.66)[i]
        solids.append(parcel.moved(Pose(exp(np.array((0, 0.25 - 0.4 * i, 0))), np.array(foot) - (0, rise, 0))))
    return solids
