"""Prediction of the pose of the next frame at constant velocity and constant turn rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]

# Time for which a motion goes on as before: people and cars change theirs within it.
MAX_EXTRAPOLATION_S = 0.5


@dataclass(frozen=True, eq=False)
class MotionPrediction:
    """The state of the motion at a time.

    Attributes
    ----------
    seconds
        The time.
    rig_from_world
        The pose.
    velocity
        (3,) of the rig in the world, per second.
    turn_rate
        (3,) rotation vector of the rig frame, radians per second.
    interval
        Time between the last two frames.
    """

    seconds: float
    rig_from_world: Pose
    velocity: Array
    turn_rate: Array
    interval: float = 0.0

    @classmethod
    def still(cls, seconds: float, rig_from_world: Pose) -> "MotionPrediction":
        """Return the state at rest."""
        return cls(seconds, rig_from_world, np.zeros(3), np.zeros(3))

    def at(self, seconds: float) -> Pose:
        """Return the predicted rig_from_world at a later time; it stays the same after a while."""
        step = min(seconds - self.seconds, max(MAX_EXTRAPOLATION_S, 1.5 * self.interval))
        rotation = so3.exp(self.turn_rate * step) @ self.rig_from_world.rotation
        center = self.rig_from_world.inverse().translation + self.velocity * step
        return Pose(rotation, -rotation @ center)

    def after(self, seconds: float, rig_from_world: Pose) -> "MotionPrediction":
        """Return the state after the pose at a later time was measured."""
        step = max(seconds - self.seconds, 1e-9)
        velocity = (rig_from_world.inverse().translation - self.rig_from_world.inverse().translation) / step
        turn = so3.log(rig_from_world.rotation @ self.rig_from_world.rotation.T) / step
        return MotionPrediction(seconds, rig_from_world, velocity, turn, step)
