"""A flat of six furnished rooms along a corridor, connected by doors."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.preset_motion import WALK, Route
from omnisight.simulation.procedural_textures import decor, materials
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes._furniture import (
    armchair,
    chair,
    floor_lamp,
    parcels,
    potted_plant,
    table,
)
from omnisight.simulation.solids import Solid, box, cylinder
from omnisight.simulation.texture import Texture

Bytes = NDArray[np.uint8]
Rng = np.random.Generator

CEILING, FLOOR = -1.3, 1.3
# Rooms lie on both sides of the corridor; walls are boxes centred on these lines.
WALLS_X, CORRIDOR, DEPTH, THICKNESS = (-6.3, -2.1, 2.1, 6.3), 0.85, 4.8, 0.12
DOOR_WIDTH, DOOR_TOP = 0.95, FLOOR - 2.05
COLOURS = ((150, 172, 176), (222, 210, 184), (188, 132, 104), (214, 196, 140), (196, 204, 190), (176, 182, 206))


def scene(seed: int = 0) -> Scene:
    """Build the flat; the origin is in the corridor, 1.3 m above the floor."""
    rng = np.random.default_rng(seed + 40)
    solids = [*_shell(rng), *_partitions(rng)]
    lamps = [(x, 0.0) for x in _middles()]
    for number, (x, side) in enumerate((x, side) for side in (-1, 1) for x in _middles()):
        solids += _furnished(x, side * (CORRIDOR + DEPTH) / 2, side, f" {number + 1}", rng)
        lamps.append((x, side * (CORRIDOR + DEPTH) / 2))
    white = Texture.plain((255, 250, 240))
    solids += [
        cylinder((x, CEILING, z), (x, CEILING + 0.05, z), 0.2, white, f"lamp {i + 1}", glow=1.0)
        for i, (x, z) in enumerate(lamps)
    ]
    return Scene(
        tuple(solids),
        ((-5.5, -0.3, -0.35), (5.5, 0.2, 0.35)),
        route=Route(_route(), 0.7, WALK),
        lamps=[((x, CEILING + 0.07, z), 0.2, 0.9) for x, z in lamps],
        ambient=0.9,
        reach=0.6,
        spacing=0.12,
    )


def _middles() -> list[float]:
    return [(a + b) / 2 for a, b in pairwise(WALLS_X)]


def _route() -> tuple[tuple[float, float, float], ...]:
    """Return a path along the corridor and back, with a turn in each room around its table."""
    points: list[tuple[float, float]] = []
    for side in (-1, 1):
        for x in _middles()[::-side]:
            door, aisle = x - 1.0, side * 0.2
            near, far = side * (CORRIDOR + 0.75), side * (DEPTH - 1.15)
            points += [(door, aisle), (door, near), (door, far), (x + 1.05, far), (x + 1.05, near), (door, near)]
            points.append((door, aisle))
    return tuple((x, -0.1, z) for x, z in points)


def _shell(rng: Rng) -> list[Solid]:
    """Return floor, ceiling and outer walls with windows, seen from inside."""
    low, high = np.array((WALLS_X[0], CEILING, -DEPTH)), np.array((WALLS_X[-1], FLOOR, DEPTH))
    width, height, depth = high - low
    far, near = (materials.plaster(rng, width, height, (224, 216, 200), trim=True) for _ in range(2))
    for wall in (far, near):
        for x in _middles():
            decor.window(wall, (x - WALLS_X[0] - 0.9, 0.42, 1.6, 1.3), rng)
    ends = {name: materials.plaster(rng, depth, height, (224, 216, 200), trim=True) for name in ("left", "right")}
    for wall in ends.values():
        decor.landscape(wall, (1.3, 0.6, 1.3, 0.85), rng)
        decor.abstract(wall, (6.9, 0.5, 0.8, 1.0))
        decor.poster(wall, (4.4, 0.4, 0.75, 1.0))
    floor = materials.planks(rng, width, depth)
    for x in _middles():
        decor.rug(floor, (x - WALLS_X[0] - 0.9, DEPTH + 1.9, 1.9, 1.7), rng)
        decor.rug(floor, (x - WALLS_X[0] - 0.9, DEPTH - 3.6, 1.9, 1.7), rng)
    # Textures of a box are as seen from outside, so mirror them.
    faces = {
        **{name: wall[:, ::-1] for name, wall in {"far": far, "near": near, **ends}.items()},
        "bottom": floor[::-1],
        "top": materials.plaster(rng, width, depth, (236, 234, 228)),
    }
    textures = {name: Texture(np.ascontiguousarray(face)) for name, face in faces.items()}
    return [box(low, high, textures, "flat", inside=True)]


def _partitions(rng: Rng) -> list[Solid]:
    """Return the walls between the rooms, and those along the corridor with their doorways."""
    solids: list[Solid] = []
    half, plain = THICKNESS / 2, Texture.plain((228, 224, 214))
    for side in (-1, 1):
        for i, x in enumerate(WALLS_X[1:-1]):
            z0, z1 = sorted((side * (CORRIDOR + half), side * DEPTH))
            faces = {
                "left": _wall(rng, z1 - z0, 3 * (side > 0) + i),
                "right": _wall(rng, z1 - z0, 3 * (side > 0) + i + 1),
            }
            solids.append(box((x - half, CEILING, z0), (x + half, FLOOR, z1), {**faces, "other": plain}, "wall"))
        z0, z1 = side * CORRIDOR - half, side * CORRIDOR + half
        for i, x in enumerate(_middles()):
            edges = (WALLS_X[i], x - 1.0 - DOOR_WIDTH / 2, x - 1.0 + DOOR_WIDTH / 2, WALLS_X[i + 1])
            for k, top in ((0, FLOOR), (1, DOOR_TOP), (2, FLOOR)):
                inner, outer = (_wall(rng, edges[k + 1] - edges[k], c, top) for c in (3 * (side > 0) + i, 4))
                faces = {"near" if side < 0 else "far": inner, "far" if side < 0 else "near": outer, "other": plain}
                solids.append(box((edges[k], CEILING, z0), (edges[k + 1], top, z1), faces, "wall"))
            solids += _door(edges[1], side)
    return solids


def _wall(rng: Rng, width: float, colour: int, bottom: float = FLOOR) -> Texture:
    """Return a decorated wall; short pieces and lintels are plain."""
    tone = COLOURS[colour % len(COLOURS)]
    if bottom < FLOOR:
        return Texture(materials.plaster(rng, width, bottom - CEILING, tone))
    if colour % 2:
        face = materials.wallpaper(rng, width, FLOOR - CEILING, tone, (112, 126, 132))
    else:
        face = materials.plaster(rng, width, FLOOR - CEILING, tone, trim=True)
    if width > 1.5:
        at = rng.uniform(0.3, width - 1.2)
        (decor.poster, decor.abstract, decor.stripes)[int(rng.integers(3))](face, (at, 0.45, 0.75, 1.0))
    return Texture(face)


def _door(x: float, side: int) -> list[Solid]:
    """Return an open door, which stands at a right angle in its room."""
    z0, z1 = sorted((side * (CORRIDOR + 0.06), side * (CORRIDOR + 0.06 + DOOR_WIDTH)))
    face = np.full((materials.px(FLOOR - DOOR_TOP), materials.px(DOOR_WIDTH), 3), (200, 196, 184), np.uint8)
    decor.door(face, (0.0, 0.0, DOOR_WIDTH, FLOOR - DOOR_TOP))
    return [box((x - 0.06, DOOR_TOP, z0), (x - 0.02, FLOOR - 0.01, z1), Texture(face), "door")]


def _furnished(x: float, z: float, side: int, number: str, rng: Rng) -> list[Solid]:
    """Return the furniture of a room with its middle at (x, z)."""
    wall = DEPTH * side
    back = wall - 0.9 if side > 0 else wall + 0.05
    pieces = [
        table((x - 0.4, 0.85, z - 0.3), (x + 0.45, 1.3, z + 0.35), rng),
        armchair((x - 0.4, 0.4, back), rng) if rng.random() < 0.6 else parcels((x - 0.1, 1.3, wall - 0.4 * side), rng),
        chair((x + 1.5, 0.3, z - 0.2), rng),
        potted_plant((x + 1.7, 1.3, wall - 0.4 * side), rng)
        if rng.random() < 0.6
        else floor_lamp((x + 1.7, 1.3, wall - 0.35 * side)),
        _cupboard((x - 2.03, z), rng),
    ]
    return [replace(solid, name=solid.name + number) for piece in pieces for solid in piece]


def _cupboard(place: tuple[float, float], rng: Rng) -> list[Solid]:
    """Return a bookcase or a sideboard along the left wall."""
    x, z = place
    body = Texture(materials.wood(rng, 1.0, 0.5, (118, 80, 50)))
    name, tall, depth = ("bookcase", 2.0, 0.28) if rng.random() < 0.5 else ("sideboard", 0.7, 0.36)
    face = np.zeros((materials.px(tall), materials.px(1.4), 3), np.uint8)
    if name == "bookcase":
        decor.shelves(face, (0, 0, 1.4, tall), rng)
    else:
        decor.sideboard(face, (0, 0, 1.4, tall))
    faces = {"right": Texture(face), "other": body}
    return [box((x, FLOOR - tall, z - 0.7), (x + depth, FLOOR, z + 0.7), faces, name)]
