"""A town on a slope: streets with repeated house fronts, parked cars, trees, lamps and signs, under a fair sky."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from omnisight.simulation.procedural_textures import materials, outdoors
from omnisight.simulation.scene import Scene
from omnisight.simulation.scenes._town_objects import Prototypes
from omnisight.simulation.scenes._town_streets import (
    GROUND,
    KERB,
    LOT,
    STEP,
    WALL,
    Frame,
    Street,
    crossing,
    roadway,
    street_textures,
)
from omnisight.simulation.scenes._town_traffic import TownPlan, driving_route, town_traffic
from omnisight.simulation.solids import Solid, rectangle
from omnisight.simulation.texture import Texture
from omnisight.simulation.traffic import Parking, ParkingSpot, placed

Rng = np.random.Generator

# Distances of the crossings, metres.
COLUMN_SPACING, ROW_SPACING = 68.0, 50.0
# Six streets, and a drive around them.
PLAN = TownPlan(
    (0.0, COLUMN_SPACING, 2 * COLUMN_SPACING),
    (0.0, ROW_SPACING, 2 * ROW_SPACING),
    ((0.0, 0.4, -0.5), (1.2, 1.6, 0.3), (1.8, 2.6, 1.4)),
    ((0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
)
# Meadow around the outer crossings: its width, and the side of its texture, metres; and its depth below the origin's
# ground.
MEADOW, MEADOW_PIECE, MEADOW_DEPTH = 157.0, 15.0, 1.2
# Side streets that leave the town end at a house.
STUB = 2.0 * LOT
# Length along which a parked car may stand, between the trees.
PARKING_SLACK = 3.5
SUN = (0.55, -0.75, -0.36)


def scene(seed: int = 0, plan: TownPlan = PLAN) -> Scene:
    """Build a town; the origin is 1.6 m above the first crossing, and the first street leads forward."""
    rng = np.random.default_rng(seed + 31)
    textures, prototypes = street_textures(rng), Prototypes(rng)
    solids: list[Solid] = []
    spots: list[ParkingSpot] = []
    for i, x in enumerate(plan.columns):
        for j, z in enumerate(plan.rows):
            name = f"crossing {len(plan.rows) * i + j + 1}"
            solids += crossing(Frame((x, z), 0.0), plan.heights[j][i], textures, name)
    for number, street in enumerate(_streets(plan), 1):
        solids += roadway(street, textures, f"street {number}")
        solids += _row_of_houses(street, -1, prototypes, rng, f"house {number}.")
        solids += _row_of_houses(street, 1, prototypes, rng, f"house {number}.")
        solids += _street_objects(street, prototypes, rng, f" {number}.")
        spots += _parking_spots(street, f" {number}.")
        if street.ends:
            solids += _closing_houses(street, prototypes, rng, f"house {number}.")
    solids.append(_meadow(plan, rng))
    parking = Parking(tuple(tuple(car) for car in prototypes.cars), tuple(spots))
    solids += parking.solids(seed, 0)
    return Scene(
        tuple(solids),
        ((-1.2, -0.6, 8.0), (1.2, 0.0, 12.0)),
        route=driving_route(plan),
        sky=Texture(outdoors.sky(rng, SUN)),
        sun=(SUN, 0.8),
        ambient=0.5,
        reach=2.5,
        spacing=3.0,
        parking=parking,
        traffic=partial(town_traffic, plan, prototypes.cars, seed),
    )


def _streets(plan: TownPlan) -> Iterator[Street]:
    """Yield the streets between the crossings, and those that leave the town from its outer crossings."""
    columns, rows, heights, *_ = plan
    for j, z in enumerate(rows):
        for i, x in enumerate(columns):
            here = heights[j][i]
            if i + 1 < len(columns):
                yield Street(Frame((x + WALL, z), np.pi / 2), columns[i + 1] - x - 2 * WALL, here, heights[j][i + 1])
            if j + 1 < len(rows):
                yield Street(Frame((x, z + WALL), 0.0), rows[j + 1] - z - 2 * WALL, here, heights[j + 1][i], True)
            for edge, yaw in ((i == 0, -np.pi / 2), (i == len(columns) - 1, np.pi / 2)):
                if edge:
                    start = (x + np.sin(yaw) * WALL, z)
                    yield Street(Frame(start, yaw), STUB, here, here, ends=True)
            for edge, yaw in ((j == 0, np.pi), (j == len(rows) - 1, 0.0)):
                if edge:
                    start = (x, z + np.cos(yaw) * WALL)
                    yield Street(Frame(start, yaw), STUB, here, here, True, ends=True)


def _meadow(plan: TownPlan, rng: Rng) -> Solid:
    """Return the square meadow below the town."""
    low, high = (np.array([end(plan.columns), end(plan.rows)]) for end in (min, max))
    pieces = int(np.ceil((np.max(high - low) + 2 * MEADOW) / MEADOW_PIECE))
    grass = Texture(materials.grass(rng, MEADOW_PIECE, MEADOW_PIECE, outdoors.PIXELS_PER_METRE), (pieces, pieces))
    wide, (x, z) = pieces * MEADOW_PIECE, 0.5 * (low + high)
    corner = (float(x) - wide / 2, GROUND + MEADOW_DEPTH, float(z) + wide / 2)
    return rectangle(corner, (wide, 0, 0), (0, 0, -wide), grass, "meadow")


def _row_of_houses(street: Street, side: int, prototypes: Prototypes, rng: Rng, name: str) -> list[Solid]:
    """Return the houses on one side; those at corners belong to the streets along x."""
    solids: list[Solid] = []
    margin = LOT if street.skips_corners else 0.0
    start, end = margin, street.length - (0.0 if street.ends else margin)
    count = round((end - start) / LOT)
    for k in range(count):
        along = start + k * LOT + (LOT if side > 0 else 0.0)
        pose = street.pose(side * WALL, along, side * np.pi / 2, at=start + (k + 0.5) * LOT)
        house = prototypes.houses[int(rng.integers(len(prototypes.houses)))]
        solids += placed(house, pose, f"{name}{2 * k + (side > 0) + 1}")
    return solids


def _closing_houses(street: Street, prototypes: Prototypes, rng: Rng, name: str) -> list[Solid]:
    """Return two houses across the end of a street."""
    solids: list[Solid] = []
    for k, x in enumerate((-LOT, 0.0)):
        house = prototypes.houses[int(rng.integers(len(prototypes.houses)))]
        solids += placed(house, street.pose(x, street.length, 0.0), f"{name}{91 + k}")
    return solids


def _street_objects(street: Street, prototypes: Prototypes, rng: Rng, number: str) -> list[Solid]:
    """Return the trees, lamp posts and signs of a street."""
    solids: list[Solid] = []
    for k, along in enumerate(np.arange(5.0, street.length - 6.0, 12.0)):
        for side in (-1, 1):
            lift, label = 0.12, f"{number}{2 * k + (side > 0) + 1}"
            turn = 0.0 if side < 0 else np.pi
            tree = prototypes.trees[int(rng.integers(len(prototypes.trees)))]
            spot = street.pose(side * 5.6, along + 3.0 * (side > 0), rng.uniform(0, 6), lift=lift)
            solids += placed(tree, spot, "tree" + label)
            post = street.pose(side * (KERB + 0.5), along + 6.0, turn, lift=lift)
            solids += placed(prototypes.lamp_post, post, "lamp post" + label)
    for side in (-1, 1):
        sign = prototypes.signs[int(rng.integers(len(prototypes.signs)))]
        along, turn = (2.0, 0.0) if side > 0 else (street.length - 2.0, np.pi)
        label = f"sign{number}{(side > 0) + 1}"
        solids += placed(sign, street.pose(side * (KERB + 0.6), along, turn, lift=0.12), label)
    return solids


def _parking_spots(street: Street, number: str) -> list[ParkingSpot]:
    """Return the places of parked cars, half on the pavement, in their driving direction."""
    spots: list[ParkingSpot] = []
    for k, along in enumerate(np.arange(5.0, street.length - 6.0, 12.0)):
        for side in (-1, 1):
            x, turn = side * (KERB + 1.0), np.pi if side < 0 else 0.0
            start, end = (street.pose(x, z, turn, lift=STEP) for z in (along, along + PARKING_SLACK))
            spots.append(ParkingSpot(start, end, f"car{number}{2 * k + (side > 0) + 1}"))
    return spots
