"""Cars that drive around a town, and people who walk around its blocks."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.simulation.preset_motion import DRIVE, WALK, Route, preset_trajectory
from omnisight.simulation.scenes._town_streets import GROUND, STEP, WALL
from omnisight.simulation.solids import Solid, cylinder, ellipsoid
from omnisight.simulation.texture import Texture
from omnisight.simulation.traffic import Actor, Limb
from omnisight.simulation.trajectory import Trajectory

Point = tuple[float, float, float]
Rng = np.random.Generator

# Middle of the right lane, and of the part of the pavement between trees and houses.
LANE, FOOTPATH = 1.7, 6.3
# Cars in each direction, and people around each block.
CARS, PEOPLE = 3, 6
CLOTHES: tuple[tuple[int, int, int], ...] = (
    *((170, 40, 44), (40, 70, 130), (210, 180, 70), (60, 110, 70), (200, 200, 196), (90, 60, 110)),
)
TROUSERS, SKIN, HAIR = ((50, 56, 76), (70, 64, 58), (34, 34, 38)), (206, 160, 130), (60, 44, 34)


class TownPlan(NamedTuple):
    """Crossings of a town on a grid.

    Attributes
    ----------
    columns, rows
        x and z of the centres.
    heights
        Heights above the ground of the world's origin, by row.
    drive
        Crossings (column, row) of a closed drive, each a neighbour of the one before.
    """

    columns: Sequence[float]
    rows: Sequence[float]
    heights: Sequence[Sequence[float]]
    drive: Sequence[tuple[int, int]]


def driving_route(plan: TownPlan, *, reverse: bool = False) -> Route:
    """Return the route of the drive through the town on the right lane."""
    drive = [*plan.drive[1::-1], *plan.drive[:1:-1]] if reverse else list(plan.drive)
    points, turns_right = list[Point](), False
    for (i, j), (k, m), (n, o) in zip(drive, drive[1:] + drive[:1], drive[2:] + drive[:2], strict=True):
        into, out = np.sign((k - i, m - j)), np.sign((n - k, o - m))
        # Right of a direction (x, z) is (z, -x).
        right_in, right_out = into[::-1] * (LANE, -LANE), out[::-1] * (LANE, -LANE)
        turns_right |= bool(right_in @ out > 0)
        centre = np.array((plan.columns[k], plan.rows[m]))
        corner = centre + right_in + (right_out if (into != out).any() else 0)
        for place in (centre - WALL * into + right_in, corner, centre + WALL * out + right_out):
            points.append((float(place[0]), -plan.heights[m][k], float(place[1])))
    # Right turns are tighter.
    return Route(tuple(points), 5.0 if turns_right else 10.0, DRIVE)


def town_traffic(plan: TownPlan, cars: Sequence[Sequence[Solid]], seed: int) -> tuple[Actor, ...]:
    """Return cars in both directions of the route, and people on the pavements around all blocks."""
    rng = np.random.default_rng((seed, 4, 1, 1))
    actors: list[Actor] = []
    for reverse in (False, True):
        motion = _on_ground(driving_route(plan, reverse=reverse), 0.0)
        # The preset trajectory begins at phase 0: no car is there.
        for k in range(CARS):
            phase = float(motion.times[-1]) * (k + rng.uniform(0.4, 0.6)) / CARS
            design = tuple(cars[int(rng.integers(len(cars)))])
            actors.append(Actor(f"driving car {len(actors) + 1}", design, motion, phase))
    people = 0
    for path in _footpaths(plan):
        motion = _on_ground(Route(path, 1.0, WALK), STEP)
        for k in range(PEOPLE):
            people += 1
            body, limbs = _person(rng)
            phase = float(motion.times[-1]) * (k + rng.uniform(0, 0.8)) / PEOPLE
            actors.append(Actor(f"person {people}", body, motion, phase, limbs))
    return tuple(actors)


def _footpaths(plan: TownPlan) -> Iterator[tuple[Point, ...]]:
    """Yield the paths around the blocks between the crossings, clockwise and counter-clockwise in turn."""
    for j, (low, high) in enumerate(zip(plan.rows, plan.rows[1:], strict=False)):
        for i, (left, right) in enumerate(zip(plan.columns, plan.columns[1:], strict=False)):
            corners = ((left, low, i, j), (right, low, i + 1, j), (right, high, i + 1, j + 1), (left, high, i, j + 1))
            points: list[Point] = []
            for k, (x, z, column, row) in enumerate(corners):
                inward = np.sign(((left + right) / 2 - x, (low + high) / 2 - z))
                before, after = (corners[(k + step) % 4] for step in (-1, 1))
                corner = np.array((x, z)) + FOOTPATH * inward
                for other in (before, None, after):
                    # The pavement is level until the wall of the first house.
                    along = np.zeros(2) if other is None else np.sign((other[0] - x, other[1] - z))
                    place = corner + 2 * (WALL - FOOTPATH) * along
                    points.append((float(place[0]), -plan.heights[row][column], float(place[1])))
            yield tuple(points if (i + j) % 2 else points[::-1])


def _on_ground(route: Route, lift: float) -> Trajectory:
    """Return the motion along a route at eye height, moved to a ground that is lifted."""
    motion = preset_trajectory("loop", ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), route=route)
    down = np.array((0.0, GROUND - lift, 0.0))
    return Trajectory(motion.times, tuple(Pose(pose.rotation, pose.translation + down) for pose in motion.poses))


def _person(rng: Rng) -> tuple[tuple[Solid, ...], tuple[Limb, ...]]:
    """Return the body of a person at the origin, and the legs and arms."""
    tall = float(rng.uniform(0.9, 1.05))
    coat, cloth = (Texture.plain(choices[int(rng.integers(len(choices)))]) for choices in (CLOTHES, TROUSERS))
    skin, hair = Texture.plain(SKIN), Texture.plain(HAIR)
    hip, shoulder = -0.86 * tall, -1.42 * tall
    body = (
        ellipsoid((0, -1.13 * tall, 0), (0.21, 0.36 * tall, 0.13), coat, "person"),
        ellipsoid((0, -1.6 * tall, 0), (0.09, 0.13, 0.11), skin, "person"),
        ellipsoid((0, -1.65 * tall, -0.02), (0.1, 0.1, 0.11), hair, "person"),
    )
    limbs: list[Limb] = []
    for side in (-1, 1):
        leg = cylinder((0, 0, 0), (0, -hip, 0), 0.075, cloth, "person")
        arm = cylinder((0, 0, 0), (0, 0.6 * tall, 0), 0.045, coat, "person")
        limbs += [Limb(leg, (0.09 * side, hip, 0.0), 0.4 * side), Limb(arm, (0.24 * side, shoulder, 0.0), -0.3 * side)]
    return body, tuple(limbs)
