"""Compilation of a scene for the compiled loops: a bounding-box tree, tables of faces and texels, and the lighting."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_for
from omnisight.simulation.bounding_box_tree import build_tree
from omnisight.simulation.solids import FACES, Solid
from omnisight.simulation.texture import LINEAR, Texture

Array = NDArray[np.float64]
Point = tuple[float, float, float]

# Colours of sunlight and skylight (red, green, blue).
SUNLIGHT, SKYLIGHT = (1.05, 1.0, 0.88), (0.93, 0.98, 1.1)
# In the order of the shape numbers in `_shapes`.
SHAPES = tuple(FACES)
# Rays for the ambient light at a point, and points on a lamp.
AMBIENT_DIRECTIONS, LAMP_POINTS = 48, 5
# Samples of the light along each side of a face.
MIN_LIGHT_SAMPLES, MAX_LIGHT_SAMPLES = 2, 128
# Light samples per task of a thread.
SAMPLES_PER_TASK = 256


@dataclass(frozen=True)
class Lighting:
    """The lights of a scene; see `Scene` for the fields."""

    lamps: Sequence[tuple[Point, float, float]]
    ambient: float
    reach: float
    spacing: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What lights a scene from far away; see `Scene` for the fields. `fog` is extinction, colour and height (5,)."""

    sky: Texture | None
    sun: tuple[Point, float]
    sunlight: Point
    skylight: Point
    fog: tuple[float, ...]


def build_world(
    solids: Sequence[Solid], names: Sequence[str], surroundings: Surroundings, spacing: float
) -> tuple[Any, list[Solid]]:
    """Return the `World` of a scene without light, and the solids in its order."""
    from omnisight.simulation._trace import Textures, Tree, World

    bounds = np.array([np.concatenate(solid.bounds()) for solid in solids]).reshape(-1, 6)
    boxes, nodes, order = build_tree(bounds)
    solids, sky = [solids[i] for i in order], surroundings.sky
    textures = list(dict.fromkeys(t for s in solids for t in s.textures))
    textures += [sky] if sky is not None else []
    number = {texture: i for i, texture in enumerate(textures)}
    number_of_name = {name: i + 1 for i, name in enumerate(names)}
    grids = [_light_grid(solid, spacing) for solid in solids]
    faces, first_face, start = [], [], 0
    for solid, sizes in zip(solids, grids, strict=True):
        first_face.append(len(faces))
        for texture, (width, height) in zip(solid.textures, sizes, strict=True):
            faces.append((number[texture], start, width, height))
            start += width * height
    sun_direction = np.array(surroundings.sun[0], float)
    return World(
        tree=Tree(
            inverse_matrices(solids),
            np.array([SHAPES.index(s.shape) for s in solids], np.int64),
            boxes,
            nodes,
        ),
        first_face=np.array(first_face, np.int64),
        instance=np.array([number_of_name[s.name] for s in solids], np.int32),
        inward=np.array([-1.0 if s.inside else 1.0 for s in solids]),
        faces=np.array(faces, np.int64).reshape(-1, 4),
        light=np.zeros(start, np.float32),
        textures=Textures(*_texels(textures), LINEAR.astype(np.float64)),
        sun=np.append(sun_direction / np.linalg.norm(sun_direction), surroundings.sun[1]),
        colors=np.array((surroundings.sunlight, surroundings.skylight), float),
        fog=np.array(surroundings.fog, float),
        sky=-1 if sky is None else number[sky],
    ), solids


def inverse_matrices(solids: Sequence[Solid]) -> Array:
    """Return local_from_world (S, 3, 4) of solids."""
    matrices = np.array([solid.world_from_local for solid in solids], float).reshape(-1, 3, 4)
    linear = np.linalg.inv(matrices[..., :3])
    return np.concatenate([linear, -linear @ matrices[..., 3:]], axis=-1)


def _texels(textures: list[Texture]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Concatenate all levels of all images; return their tables `tables`, `levels` and `texels`."""
    rows: list[tuple[int, int, int, int]] = []
    levels: list[tuple[int, int, int]] = []
    texels: list[NDArray[np.uint8]] = [np.zeros((0, 3), np.uint8)]
    first_level: dict[int, tuple[int, int]] = {}
    start = 0
    for texture in textures:
        # Textures that repeat one image differently share its levels.
        image = id(texture.image)
        if image not in first_level:
            first_level[image] = len(levels), len(texture.levels)
            for level in texture.levels:
                levels.append((start, level.shape[1], level.shape[0]))
                texels.append(level.reshape(-1, 3))
                start += level.shape[0] * level.shape[1]
        rows.append((*first_level[image], *texture.repeat))
    return (
        np.array(rows, np.int64).reshape(-1, 4),
        np.array(levels, np.int64).reshape(-1, 3),
        np.concatenate(texels),
    )


def _light_grid(solid: Solid, spacing: float) -> list[tuple[int, int]]:
    """Return the number of light samples along u and v of each face."""
    if solid.glow is not None:
        return [(1, 1)] * len(solid.textures)
    x, y, z = np.linalg.norm(solid.world_from_local[:, :3], axis=0)
    sides = {
        "rectangle": ((x, y),),
        "box": ((z, y), (z, y), (x, z), (x, z), (x, y), (x, y)),
        "ellipsoid": ((2 * np.pi * x, np.pi * y),),
        "cylinder": ((2 * np.pi * x, y), (2 * x, 2 * z), (2 * x, 2 * z)),
        "roof": ((x, np.hypot(y, z / 2)), (x, np.hypot(y, z / 2)), (z, y), (z, y), (x, z)),
    }[solid.shape]
    low, high = MIN_LIGHT_SAMPLES, MAX_LIGHT_SAMPLES
    counts = [[int(np.clip(np.ceil(side / spacing), low, high)) for side in pair] for pair in sides]
    return [(width, height) for width, height in counts]


def illuminate(world: Any, solids: Sequence[Solid], lighting: Lighting, lights: dict[Solid, Any]) -> None:
    """Fill the light of a world. `lights` caches the light of each solid; missing entries are computed and added."""
    from omnisight.simulation import _shading

    grids = [_light_grid(solid, lighting.spacing) for solid in solids]
    samples: list[Array] = []
    added: list[tuple[Solid, int, int]] = []
    count = 0
    for i, (solid, sizes) in enumerate(zip(solids, grids, strict=True)):
        if solid.glow is not None or solid in lights:
            continue
        first_sample = count
        for face, (width, height) in enumerate(sizes):
            u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
            samples.append(np.column_stack([np.full(u.size, i), np.full(u.size, face), u.ravel(), v.ravel()]))
            count += u.size
        added.append((solid, first_sample, count))
    if count:
        every = np.concatenate(samples)
        light = np.empty(count, np.float32)
        forward = np.array([solid.world_from_local for solid in solids])
        directions, lamps = _cosine_directions(), _lamp_points(lighting.lamps)
        ambient, reach = float(lighting.ambient), float(lighting.reach)
        parallel_for(
            lambda first, last: _shading.precompute_light(
                world, forward, every, directions, lamps, ambient, reach, light, first, last
            ),
            count,
            SAMPLES_PER_TASK,
        )
        lights.update({solid: light[first:end] for solid, first, end in added})
    start = 0
    for solid, sizes in zip(solids, grids, strict=True):
        size = sum(width * height for width, height in sizes)
        world.light[start : start + size] = lights[solid] if solid.glow is None else solid.glow
        start += size


def _cosine_directions() -> Array:
    """Return directions (K, 3) about z with cosine-weighted density: a spiral on the disc, projected to the sphere."""
    k = np.arange(AMBIENT_DIRECTIONS) + 0.5
    radius, turn = np.sqrt(k / AMBIENT_DIRECTIONS), k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)])


def _lamp_points(disc_lamps: Sequence[tuple[Point, float, float]]) -> Array:
    """Return points (M, 4) of the lamps and their strengths: the centre and a ring of each."""
    points = [
        (x + away * np.cos(turn), y, z + away * np.sin(turn), strength / LAMP_POINTS)
        for (x, y, z), radius, strength in disc_lamps
        for away, turn in [(0.0, 0.0), *((0.7 * radius, i * 2 * np.pi / (LAMP_POINTS - 1)) for i in range(4))]
    ]
    return np.array(points, float).reshape(-1, 4)
