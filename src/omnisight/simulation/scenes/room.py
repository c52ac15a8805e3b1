"""A furnished living room of 5.4 x 5.2 m."""

import numpy as np
from numpy.typing import NDArray

from omnisight.simulation.procedural_textures import decor, materials
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes._furniture import (
    armchair,
    chair,
    floor_lamp,
    parcels,
    potted_plant,
    sideboard_objects,
    table,
)
from omnisight.simulation.solids import Solid, box, cylinder
from omnisight.simulation.texture import Texture

Bytes = NDArray[np.uint8]

LOW, HIGH = (-2.7, -1.3, -2.3), (2.7, 1.3, 2.9)
LAMPS = [(x, z) for x in (-1.2, 1.2) for z in (-0.75, 1.35)]


def scene(seed: int = 0) -> Scene:
    """Build the room; the origin is 1.3 m above the floor."""
    rng = np.random.default_rng(seed + 20)
    solids = [
        *_shell(rng),
        *_cupboards(rng),
        *table((0.3, 0.85, 0.65), (1.15, 1.3, 1.3), rng),
        *armchair((-1.75, 0.4, 1.25), rng),
        *chair((1.35, 0.3, -1.75), rng),
        *floor_lamp((2.3, 1.3, 2.45)),
        *potted_plant((-2.25, 1.3, 2.5), rng),
        *sideboard_objects((-0.75, 0.62, 2.65), rng),
        *parcels((-1.5, 1.3, -1.9), rng),
    ]
    white = Texture.plain((255, 250, 240))
    solids += [
        cylinder((x, LOW[1], z), (x, LOW[1] + 0.05, z), 0.2, white, f"lamp {i + 1}", glow=1.0)
        for i, (x, z) in enumerate(LAMPS)
    ]
    lamps = [((x, LOW[1] + 0.07, z), 0.2, 0.6) for x, z in LAMPS]
    return Scene(
        tuple(solids), ((-1.1, -0.5, -1.2), (1.1, 0.25, 1.0)), lamps=lamps, ambient=0.95, reach=0.6, spacing=0.07
    )


def _shell(rng: np.random.Generator) -> list[Solid]:
    """Return the room's shell: decorated walls, floor and ceiling."""
    width, height, depth = (b - a for a, b in zip(LOW, HIGH, strict=True))
    front = materials.wallpaper(rng, width, height, (150, 172, 176), (112, 136, 142))
    decor.poster(front, (0.62, 0.45, 0.95, 1.25))
    decor.landscape(front, (2.05, 0.55, 1.5, 0.95), rng)
    decor.abstract(front, (4.05, 0.5, 0.75, 0.75))
    right = materials.plaster(rng, depth, height, (222, 210, 184), trim=True)
    decor.window(right, (0.7, 0.42, 1.9, 1.32), rng)
    back = materials.plaster(rng, width, height, (188, 132, 104), trim=True)
    decor.door(back, (0.75, 0.5, 0.95, 2.1))
    decor.abstract(back, (2.5, 0.55, 0.8, 1.0))
    decor.landscape(back, (3.75, 0.6, 1.2, 0.8), rng)
    left = materials.wallpaper(rng, depth, height, (214, 196, 140), (176, 152, 92))
    decor.stripes(left, (2.75, 0.3, 1.0, 1.3))
    decor.poster(left, (4.1, 0.35, 0.75, 1.0))
    floor = materials.planks(rng, width, depth)
    decor.rug(floor, (1.55, 1.5, 2.3, 1.9), rng)
    ceiling = materials.plaster(rng, width, depth, (236, 234, 228))
    # Textures of a box are as seen from outside, so mirror them.
    faces = {
        **{name: wall[:, ::-1] for name, wall in {"far": front, "right": right, "near": back, "left": left}.items()},
        "bottom": floor[::-1],
        "top": ceiling[::-1],
    }
    textures = {name: Texture(np.ascontiguousarray(face)) for name, face in faces.items()}
    return [box(LOW, HIGH, textures, "room", inside=True)]


def _cupboards(rng: np.random.Generator) -> list[Solid]:
    """Return two bookcases and two sideboards along the walls."""
    body = Texture(materials.wood(rng, 1.0, 0.5, (118, 80, 50)))
    dark = Texture(materials.wood(rng, 1.0, 0.5, (104, 72, 46)))

    def books(width: float, height: float) -> Texture:
        face = _blank(width, height)
        decor.shelves(face, (0, 0, width, height), rng)
        return Texture(face)

    def doors(width: float, height: float) -> Texture:
        face = _blank(width, height)
        decor.sideboard(face, (0, 0, width, height))
        return Texture(face)

    return [
        box((2.35, -1.05, -1.8), (2.7, 1.3, -0.45), {"left": books(1.35, 2.35), "other": body}, "bookcase 1"),
        box((-2.7, -1.05, -1.85), (-2.35, 1.3, -0.15), {"right": books(1.7, 2.35), "other": body}, "bookcase 2"),
        box((-0.75, 0.62, 2.45), (0.95, 1.3, 2.9), {"near": doors(1.7, 0.68), "other": dark}, "sideboard 1"),
        box((-2.7, 0.65, 0.3), (-2.25, 1.3, 2.1), {"right": doors(1.8, 0.65), "other": dark}, "sideboard 2"),
    ]


def _blank(width: float, height: float) -> Bytes:
    return np.zeros((materials.px(height), materials.px(width), 3), np.uint8)
