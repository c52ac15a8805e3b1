"""Objects of a town, each built once at the origin and placed many times with shared textures."""

import numpy as np

from omnisight.simulation.procedural_textures import materials, outdoors
from omnisight.simulation.scenes._outdoors import car, lamp_post, road_sign, tree
from omnisight.simulation.scenes._town_streets import DENSITY, LOT
from omnisight.simulation.solids import Solid, box, cylinder, roof
from omnisight.simulation.texture import Texture

Rng = np.random.Generator

# House designs; each of them is repeated.
FRONTS, STOREYS = 8, (2, 3, 3, 4)
# How far houses reach below the ground at their middle, because the street is on a slope.
PLINTH = 1.5


class Prototypes:
    """Objects at the origin, on the ground, in several designs."""

    def __init__(self, rng: Rng) -> None:
        leaf = [Texture(materials.leaves(rng, colour)) for colour in ((74, 112, 48), (92, 116, 52))]
        bark = Texture(materials.bark(rng))
        self.houses = _houses(rng)
        self.trees = [tree((0, 0, 0), leaf[i % 2], bark, "tree", rng, tall=5.0 + 0.5 * i) for i in range(3)]
        self.cars = [car((0, 0, 0), "car", rng) for _ in range(5)]
        self.signs = [road_sign((0, 0, 0), words, "sign") for words in ("30", "20", "50")]
        self.lamp_post = lamp_post((0, 0, 0), 1, "lamp post")


def _houses(rng: Rng) -> list[list[Solid]]:
    """Return house designs on lots of x from 0 to LOT and z from 0, the front, to LOT."""
    slopes = [Texture(materials.tiles(rng, LOT, 5.5, c, DENSITY)) for c in ((150, 78, 58), (92, 88, 92))]
    gables: dict[float, Texture] = {}
    stone = Texture(materials.bricks(rng, LOT, PLINTH, (150, 146, 138), DENSITY))
    houses: list[list[Solid]] = []
    for i in range(FRONTS):
        tall = 0.9 + 2.9 * STOREYS[i % len(STOREYS)]
        if tall not in gables:
            gables[tall] = Texture(materials.bricks(rng, LOT, tall, (150, 96, 78), DENSITY))
        front = Texture(outdoors.front(rng, LOT, tall))
        houses.append(_house(tall, front, gables[tall], slopes[i % 2], stone))
    return houses


def _house(tall: float, front: Texture, gable: Texture, slope: Texture, stone: Texture) -> list[Solid]:
    top, over, iron = -tall - 2.6, 0.3, Texture.plain((92, 94, 98))
    return [
        box((0, -tall, 0), (LOT, 0, LOT), {"near": front, "other": gable}, "house"),
        box((0, 0, 0.02), (LOT, PLINTH, LOT), stone, "house"),
        roof((0, top, -over), (LOT, 0.02 - tall, LOT + over), {"near": slope, "far": slope, "other": gable}, "house"),
        box((1.2, top - 0.7, 5.6), (1.9, top + 2.2, 6.2), gable, "house"),
        cylinder((0.1, -tall, -0.06), (0.1, 0.0, -0.06), 0.05, iron, "house"),
    ]
