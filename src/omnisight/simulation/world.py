"""Makes of a scene what the compiled loops run over: a tree of boxes, tables of faces and texels, and the light."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import parallel_for
from omnisight.simulation.solids import FACES, Solid
from omnisight.simulation.texture import LINEAR, Texture

if TYPE_CHECKING:
    from omnisight.simulation.scene import Scene

Array = NDArray[np.float64]

SHAPES = tuple(FACES)  # in the order of the numbers in `_shapes`
LEAF = 2  # solids
PAD = 1e-6  # metres around a box of the tree
DIRECTIONS, LAMP_POINTS = 48, 5
FINEST, COARSEST = 2, 128  # places of a face at which its light is worked out, along each side
SPOTS_AT_ONCE = 256


def build(scene: "Scene") -> tuple[Any, list[Solid]]:
    """Give the scene's `World`, its light still dark, and the solids in the order in which they stand in it."""
    from omnisight.simulation._trace import World

    bounds = np.array([np.concatenate(solid.bounds()) for solid in scene.solids]).reshape(-1, 6)
    boxes, nodes, order = _tree(bounds)
    solids = [scene.solids[i] for i in order]
    textures = list(dict.fromkeys(t for s in solids for t in s.textures))
    textures += [scene.sky] if scene.sky is not None else []
    number = {texture: i for i, texture in enumerate(textures)}
    rows, levels, texels = _texels(textures)
    grids = [_grid(solid, scene.spacing) for solid in solids]
    faces, first_face, start = [], [], 0
    for solid, sizes in zip(solids, grids, strict=True):
        first_face.append(len(faces))
        for texture, (width, height) in zip(solid.textures, sizes, strict=True):
            faces.append((number[texture], start, width, height))
            start += width * height
    towards = np.array(scene.sun[0], float)
    return World(
        local_from_world=np.array([_inverse(s.world_from_local) for s in solids]).reshape(-1, 3, 4),
        kinds=np.array([SHAPES.index(s.shape) for s in solids], np.int64),
        first_face=np.array(first_face, np.int64),
        instance=np.array([scene.names.index(s.name) + 1 for s in solids], np.int32),
        inward=np.array([-1.0 if s.inside else 1.0 for s in solids]),
        boxes=boxes,
        nodes=nodes,
        faces=np.array(faces, np.int64).reshape(-1, 4),
        light=np.zeros(start, np.float32),
        textures=rows,
        levels=levels,
        texels=texels,
        linear=LINEAR,
        sun=np.append(towards / np.linalg.norm(towards), scene.sun[1]),
        sky=-1 if scene.sky is None else number[scene.sky],
    ), solids


def _inverse(matrix: Array) -> Array:
    linear = np.linalg.inv(matrix[:, :3])
    return np.column_stack([linear, -linear @ matrix[:, 3]]).astype(float)


def _tree(bounds: Array) -> tuple[Array, NDArray[np.int64], list[int]]:
    """Give the boxes and nodes of a tree over solids, parents first, and the order in which solids stand in it."""
    middles = (bounds[:, :3] + bounds[:, 3:]) / 2
    boxes: list[Array] = []
    nodes: list[list[int]] = []
    order: list[int] = []

    def grow(members: NDArray[np.int64]) -> None:
        here = len(nodes)
        inside = bounds[members]
        boxes.append(np.concatenate([inside[:, :3].min(0) - PAD, inside[:, 3:].max(0) + PAD]))
        nodes.append([0, len(order), 0])
        # A solid as large as the whole, such as the room's shell, would make every part as large.
        size = (inside[:, 3:] - inside[:, :3]).max(1)
        huge = size > 0.6 * (inside[:, 3:].max(0) - inside[:, :3].min(0)).max()
        if len(members) <= LEAF or huge.all():
            own, rest = members, members[:0]
        else:
            own, rest = members[huge], members[~huge]
        order.extend(int(i) for i in own)
        nodes[here][2] = len(own)
        if len(rest):
            spans = np.ptp(middles[rest], axis=0)
            along = rest[np.argsort(middles[rest, np.argmax(spans)], kind="stable")]
            half = len(along) // 2
            for part in (along[:half], along[half:]) if half else (along,):
                grow(part)
        nodes[here][0] = len(nodes)

    if len(bounds):
        grow(np.arange(len(bounds)))
    return np.array(boxes).reshape(-1, 6), np.array(nodes, np.int64).reshape(-1, 3), order


def _texels(textures: list[Texture]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.uint8]]:
    """Lay all levels of all textures end to end."""
    rows: list[tuple[int, int]] = []
    levels: list[tuple[int, int, int]] = []
    texels: list[NDArray[np.uint8]] = [np.zeros((0, 3), np.uint8)]
    start = 0
    for texture in textures:
        rows.append((len(levels), len(texture.levels)))
        for level in texture.levels:
            levels.append((start, level.shape[1], level.shape[0]))
            texels.append(level.reshape(-1, 3))
            start += level.shape[0] * level.shape[1]
    return (
        np.array(rows, np.int64).reshape(-1, 2),
        np.array(levels, np.int64).reshape(-1, 3),
        np.concatenate(texels),
    )


def _grid(solid: Solid, spacing: float) -> list[tuple[int, int]]:
    """Give at how many places along u and v of each face its light is worked out."""
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
    counts = [[int(np.clip(np.ceil(side / spacing), FINEST, COARSEST)) for side in pair] for pair in sides]
    return [(width, height) for width, height in counts]


def illuminate(scene: "Scene", world: Any, solids: Sequence[Solid], lights: dict[Solid, Any]) -> None:
    """Fill the world's light; what `lights` has not yet is worked out and put there."""
    from omnisight.simulation import _shading

    grids = [_grid(solid, scene.spacing) for solid in solids]
    spots: list[Array] = []
    fresh: list[tuple[Solid, int, int]] = []
    count = 0
    for i, (solid, sizes) in enumerate(zip(solids, grids, strict=True)):
        if solid.glow is not None or solid in lights:
            continue
        begun = count
        for face, (width, height) in enumerate(sizes):
            u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
            spots.append(np.column_stack([np.full(u.size, i), np.full(u.size, face), u.ravel(), v.ravel()]))
            count += u.size
        fresh.append((solid, begun, count))
    if count:
        every = np.concatenate(spots)
        fallen = np.empty(count, np.float32)
        forward = np.array([solid.world_from_local for solid in solids])
        ways, lamps = _cosine_spread(), _lamp_points(scene)
        ambient, reach = float(scene.ambient), float(scene.reach)
        parallel_for(
            lambda first, last: _shading.illuminate(
                world, forward, every, ways, lamps, ambient, reach, fallen, first, last
            ),
            count,
            SPOTS_AT_ONCE,
        )
        lights.update({solid: fallen[begun:end] for solid, begun, end in fresh})
    start = 0
    for solid, sizes in zip(solids, grids, strict=True):
        size = sum(width * height for width, height in sizes)
        world.light[start : start + size] = lights[solid] if solid.glow is None else solid.glow
        start += size


def _cosine_spread() -> Array:
    """Give directions (K, 3) about z, parallel_for as the cosine of their angle from it: a spiral on the disc, lifted."""
    k = np.arange(DIRECTIONS) + 0.5
    radius, turn = np.sqrt(k / DIRECTIONS), k * np.pi * (3 - np.sqrt(5))
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)])


def _lamp_points(scene: "Scene") -> Array:
    """Give points (M, 4) of the lamps and their strengths: one amid each, the others around."""
    points = [
        (x + away * np.cos(turn), y, z + away * np.sin(turn), strength / LAMP_POINTS)
        for (x, y, z), radius, strength in scene.lamps
        for away, turn in [(0.0, 0.0), *((0.7 * radius, i * 2 * np.pi / (LAMP_POINTS - 1)) for i in range(4))]
    ]
    return np.array(points, float).reshape(-1, 4)
