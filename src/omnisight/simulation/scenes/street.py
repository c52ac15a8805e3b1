"""A street of terraced houses with parked cars, trees and lamps, under a fair sky."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.procedural_textures import materials, outdoors
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes._outdoors import bench, car, lamp_post, poster_column, road_sign, tree
from omnisight.simulation.solids import Solid, box, cylinder, rectangle, roof
from omnisight.simulation.texture import Texture

Rng = np.random.Generator

DENSITY = outdoors.PIXELS_PER_METRE
GROUND = 1.6
START, END = -42.0, 66.0
KERB, WALL, BACK = 3.6, 6.8, 16.0
SUN = (-0.5, -0.72, -0.42)
CARS = ((-2.6, -14.0), (-2.6, 9.0), (-2.6, 15.5), (2.6, -8.0), (2.6, 6.0), (2.6, 22.0), (-2.6, 31.0), (2.6, 38.0))


def scene(seed: int = 0) -> Scene:
    """Build the street along z; the origin is 1.6 m above the road."""
    rng = np.random.default_rng(seed + 11)
    solids = [*_ground(rng), *_houses(rng, -1), *_houses(rng, 1), *_far_end(rng)]
    leaf, bark = [Texture(materials.leaves(rng)) for _ in range(3)], Texture(materials.bark(rng))
    foot = GROUND - 0.12
    for i, z in enumerate(np.arange(-24.0, 52.0, 15.0)):
        for side in (-1, 1):
            solids += tree((side * 5.5, foot, z + 3 * side), leaf[i % 3], bark, f"tree {side * (i + 1)}", rng)
            solids += lamp_post((side * 4.1, foot, z + 9), -side, f"lamp post {side * (i + 1)}")
    for i, (x, z) in enumerate(CARS):
        solids += car((x, GROUND, z), f"car {i + 1}", rng)
    solids += poster_column((-4.7, foot, 2.6), rng)
    solids += bench((4.9, foot, 2.0), rng) + bench((-4.9, foot, 24.0), rng)
    solids += road_sign((4.0, foot, 12.0), "30", "sign 1") + road_sign((-4.0, foot, 19.0), "20", "sign 2")
    return Scene(
        tuple(solids),
        ((-1.2, -0.6, -6.0), (1.2, 0.6, 18.0)),
        sky=Texture(outdoors.sky(rng, SUN)),
        sun=(SUN, 0.8),
        ambient=0.5,
        reach=2.5,
        spacing=0.6,
    )


def _ground(rng: Rng) -> list[Solid]:
    long = END - START

    def flat(name: str, x0: float, x1: float, y: float, image: Texture) -> Solid:
        return rectangle((x0, y, END), (x1 - x0, 0, 0), (0, 0, -long), image, name)

    stone = Texture(materials.paving(rng, 4.0, 0.3, 0.8, DENSITY, (150, 148, 144)))
    solids = [flat("road", -KERB, KERB, GROUND, Texture(outdoors.road(rng, 2 * KERB, long)))]
    for side in (-1, 1):
        x0, x1 = sorted((side * KERB, side * WALL))
        # The slabs are 0.5 m long: a joint hides where the texture repeats.
        slabs = Texture(materials.paving(rng, x1 - x0, long / 9, 0.5, DENSITY, (164, 160, 152)), (1, 9))
        solids.append(flat(f"pavement {side}", x0, x1, GROUND - 0.12, slabs))
        kerb = sorted((side * KERB, side * (KERB + 0.12)))
        solids.append(box((kerb[0], GROUND - 0.121, START), (kerb[1], GROUND, END), stone, f"pavement {side}"))
    wide = 300.0
    meadow = Texture(materials.grass(rng, 15.0, 15.0, DENSITY), (20, 20))
    solids.append(rectangle((-wide / 2, GROUND + 0.03, wide / 2), (wide, 0, 0), (0, 0, -wide), meadow, "meadow"))
    return solids


def _houses(rng: Rng, side: int) -> list[Solid]:
    """Return a row of houses on one side (-1 left, 1 right)."""
    solids: list[Solid] = []
    gables: dict[float, Texture] = {}
    z, number = START + 2, 0
    while z < END - 7:
        number += 1
        width, tall = float(rng.uniform(6.5, 10.5)), 0.9 + 2.9 * int(rng.integers(2, 5))
        name = f"house {side * number}"
        setback = float(rng.choice((0.0, 0.0, 0.25)))
        x0, x1 = sorted((side * (WALL + setback), side * BACK))
        if tall not in gables:
            gables[tall] = Texture(materials.bricks(rng, BACK - WALL, tall, (150, 96, 78), DENSITY))
        gable = gables[tall]
        front = Texture(outdoors.front(rng, width, tall))
        walls = {"left" if side > 0 else "right": front, "other": gable}
        solids.append(box((x0, GROUND - tall, z), (x1, GROUND, z + width), walls, name))
        colour = ((150, 78, 58), (92, 88, 92), (128, 70, 54))[int(rng.integers(3))]
        slope = Texture(materials.tiles(rng, width, 5.5, colour, DENSITY))
        # The roof is built with its ridge along x and rotated into the street direction: x becomes z, z becomes -x.
        turned = Pose(exp(np.array((0, -np.pi / 2, 0))))
        over = 0.35
        low, high = (z, -tall - 2.6, -x1 - over), (z + width, -tall + 0.02, -x0 + over)
        solids.append(roof(low, high, {"near": slope, "far": slope, "other": gable}, name).moved(turned))
        solids[-1] = solids[-1].moved(Pose(translation=np.array((0, GROUND, 0))))
        middle = (x0 + x1) / 2 + 1.2
        top = GROUND - tall - 3.2
        solids.append(box((middle, top, z + 0.8), (middle + 0.6, top + 2.2, z + 1.5), gable, name))
        pipe = side * (WALL + setback - 0.06)
        iron = Texture.plain((92, 94, 98))
        solids.append(cylinder((pipe, GROUND - tall, z + 0.1), (pipe, GROUND - 0.12, z + 0.1), 0.05, iron, name))
        z += width
    return solids


def _far_end(rng: Rng) -> list[Solid]:
    """Close the street with trees at one end and a tower at the other."""
    leaf, bark = Texture(materials.leaves(rng, (84, 118, 60))), Texture(materials.bark(rng))
    solids: list[Solid] = []
    for i in range(9):
        place = (-16.0 + 4 * i, GROUND, START - 6 - 4.0 * (i % 2))
        solids += tree(place, leaf, bark, f"grove {i + 1}", rng, tall=8.0)
        place = (-26.0 + 6.5 * i, GROUND, END + 12 + 5.0 * (i % 2))
        solids += tree(place, leaf, bark, f"wood {i + 1}", rng, tall=7.0)
    stone = Texture(materials.bricks(rng, 8, 16, (196, 182, 156), DENSITY))
    slate = Texture(materials.tiles(rng, 8, 6, (92, 92, 102), DENSITY))
    solids.append(box((-4, GROUND - 17, END + 14), (4, GROUND, END + 22), stone, "tower"))
    solids.append(
        roof((-4.3, GROUND - 24, END + 13.7), (4.3, GROUND - 17, END + 22.3), {"near": slate, "other": stone}, "tower")
    )
    return solids
