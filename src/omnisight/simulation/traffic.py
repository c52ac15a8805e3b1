"""Cars that park elsewhere at another visit, and objects that move."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.solids import Solid
from omnisight.simulation.trajectory import Trajectory

# Duration of two steps of a walking person, seconds.
STRIDE_S = 1.1


def placed(solids: Sequence[Solid], pose: Pose, name: str) -> list[Solid]:
    """Return an object at a pose, under a name of its own."""
    return [replace(solid.moved(pose), name=name) for solid in solids]


@dataclass(frozen=True)
class ParkingSpot:
    """A position where a car may stand.

    Attributes
    ----------
    start, end
        Poses of a car at the ends of the spot.
    name
        Name of the car.
    """

    start: Pose
    end: Pose
    name: str


@dataclass(frozen=True, eq=False)
class Parking:
    """Parking spots of a scene.

    Attributes
    ----------
    cars
        Designs of cars at the origin.
    spots
        The spots.
    occupied
        Share of the spots where a car stands.
    """

    cars: tuple[tuple[Solid, ...], ...]
    spots: tuple[ParkingSpot, ...]
    occupied: float = 0.6

    def solids(self, seed: int, visit: int) -> list[Solid]:
        """Return the cars that are parked at a visit; each visit draws them anew."""
        rng = np.random.default_rng((seed, visit, 3, 1))
        solids: list[Solid] = []
        for spot in self.spots:
            stands, along, design = rng.random() < self.occupied, rng.random(), int(rng.integers(len(self.cars)))
            if stands:
                place = (1 - along) * spot.start.translation + along * spot.end.translation
                solids += placed(self.cars[design], Pose(spot.start.rotation, place), spot.name)
        return solids


@dataclass(frozen=True, eq=False)
class Limb:
    """A part that swings about x.

    Attributes
    ----------
    solid
        At the origin, hanging down from its joint.
    joint
        Position in the frame of the object.
    amplitude
        Radians; negative for the opposite direction.
    """

    solid: Solid
    joint: tuple[float, float, float]
    amplitude: float

    def at(self, time: float) -> Solid:
        """Return the part in the frame of the object at a time."""
        angle = self.amplitude * np.sin(2 * np.pi * time / STRIDE_S)
        return self.solid.moved(Pose(exp(np.array((angle, 0.0, 0.0))), np.array(self.joint)))


@dataclass(frozen=True, eq=False)
class Actor:
    """An object that moves along a closed path.

    Attributes
    ----------
    name
        Name of the object.
    solids, limbs
        At the origin, on the ground, heading for +z.
    motion
        One round of the ground point; it repeats.
    phase
        Time of the motion at time 0, seconds.
    """

    name: str
    solids: tuple[Solid, ...]
    motion: Trajectory
    phase: float
    limbs: tuple[Limb, ...] = ()

    def pose(self, time: float) -> Pose:
        """Return the pose on the ground at a time."""
        start, end = self.motion.times[0], self.motion.times[-1]
        return self.motion.at(float(start + (time + self.phase) % (end - start)))

    def at(self, time: float) -> list[Solid]:
        """Return the solids at a time."""
        moving = [limb.at(time + self.phase) for limb in self.limbs]
        return placed((*self.solids, *moving), self.pose(time), self.name)
