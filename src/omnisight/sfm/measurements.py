"""Measurements of cameras in metres, which fix place and scale of the world in bundle adjustment."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class LinearizedMeasurements(NamedTuple):
    """Whitened residuals (R,), the frames (R, K) that they depend on, and derivatives (R, K, 6) by their steps."""

    residuals: Array
    frames: Indices
    derivatives: Array


class Measurements(Protocol):
    """What was measured of the cameras besides their images."""

    @property
    def fixes_gauge(self) -> bool:
        """Whether they determine position and orientation of the world, besides its scale."""
        ...

    def linearize(self, rig_from_world: Array) -> LinearizedMeasurements:
        """Return the measurements at poses (F, 3, 4)."""
        ...


@dataclass(frozen=True, eq=False)
class MeasuredPositions:
    """Positions of images.

    Attributes
    ----------
    frames
        (N,) their frames.
    centers
        (N, 3) of their cameras, in the rig.
    positions
        (N, 3) in the world.
    sigma
        (3,) standard deviations along the axes of the world.
    """

    frames: Indices
    centers: Array
    positions: Array
    sigma: Array
    fixes_gauge = True

    def linearize(self, rig_from_world: Array) -> LinearizedMeasurements:
        """Return the differences of the positions, and their derivatives."""
        positions, derivatives = camera_positions(rig_from_world[self.frames], self.centers)
        residuals = (positions - self.positions) / self.sigma
        frames = np.repeat(self.frames[:, None], 3, axis=0)
        return LinearizedMeasurements(residuals.ravel(), frames, (derivatives / self.sigma[:, None]).reshape(-1, 1, 6))


@dataclass(frozen=True, eq=False)
class MeasuredDistance:
    """The distance between two images.

    Attributes
    ----------
    frames
        (2,) their frames.
    centers
        (2, 3) of their cameras, in the rig.
    distance, sigma
        Value and standard deviation.
    """

    frames: Indices
    centers: Array
    distance: float
    sigma: float
    fixes_gauge = False

    def linearize(self, rig_from_world: Array) -> LinearizedMeasurements:
        """Return the difference of the distances, and its derivatives."""
        positions, derivatives = camera_positions(rig_from_world[self.frames], self.centers)
        baseline = positions[1] - positions[0]
        length = float(np.linalg.norm(baseline))
        along = baseline / length / self.sigma
        by_step = np.stack([-along @ derivatives[0], along @ derivatives[1]])
        residual = np.array([(length - self.distance) / self.sigma])
        return LinearizedMeasurements(residual, self.frames[None], by_step[None])


def camera_positions(rig_from_world: Array, centers: Array) -> tuple[Array, Array]:
    """Return the positions (N, 3) of cameras in the world, and their derivatives (N, 3, 6) by steps of the poses.

    Parameters
    ----------
    rig_from_world
        (N, 3, 4).
    centers
        (N, 3) of the cameras in the rig.
    """
    world_from_rig = rig_from_world[:, :, :3].transpose(0, 2, 1)
    arms = centers - rig_from_world[:, :, 3]
    positions = np.einsum("nij,nj->ni", world_from_rig, arms)
    derivatives = np.concatenate([world_from_rig @ so3.hat(arms), -world_from_rig], axis=2)
    return positions, derivatives
