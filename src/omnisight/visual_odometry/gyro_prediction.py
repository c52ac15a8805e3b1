"""Prediction of the rotation between images by a gyroscope whose orientation on the camera need not be known."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.imu import ImuSamples

Array = NDArray[np.float64]

# Root mean square angle (radians) of turns about the second axis that determine the orientation to a few degrees.
MIN_TURN_RAD = np.radians(2.0)
# Share of the turns that the orientation must explain.
MIN_EXPLAINED = 0.9


@dataclass
class GyroPrediction:
    """Turns of the camera from those of the gyroscope.

    The orientation rig_from_imu is the rotation that aligns their turns best (Wahba's problem; J. Markley, 1988). It is
    learned from the first images, in which the camera must turn about two axes.

    Attributes
    ----------
    imu
        The measurements.
    """

    imu: ImuSamples
    _products: Array = field(default_factory=lambda: np.zeros((3, 3)), repr=False)
    _squares: float = field(default=0.0, repr=False)

    def learn(self, seconds: tuple[float, float], turn: Array) -> None:
        """Add the measured turn (3,) of the camera between two times, as a rotation vector of the rig frame."""
        measured = self._turn(*seconds)
        if measured is not None:
            self._products += np.outer(turn, measured)
            self._squares += float(np.linalg.norm(turn) * np.linalg.norm(measured))

    @property
    def rig_from_imu(self) -> Array | None:
        """The orientation (3, 3); None while it is unknown."""
        u, values, v = np.linalg.svd(self._products)
        sign = np.sign(np.linalg.det(u @ v))
        if values[1] < MIN_TURN_RAD**2 or values[0] + values[1] + sign * values[2] < MIN_EXPLAINED * self._squares:
            return None
        return np.asarray(u @ np.diag([1.0, 1.0, sign]) @ v, float)

    def turned(self, predicted: Pose, before: Pose, seconds: tuple[float, float]) -> Pose:
        """Return a predicted rig_from_world with the measured rotation since a pose before, if that is known."""
        rotation, turn = self.rig_from_imu, self._turn(*seconds)
        if rotation is None or turn is None:
            return predicted
        now = so3.exp(rotation @ turn) @ before.rotation
        return Pose(now, -now @ predicted.inverse().translation)

    def _turn(self, start: float, end: float) -> Array | None:
        """Return the rotation vector end_from_start (3,) of the IMU, biased by its gyroscope; None if unknown."""
        samples = self.imu.between(start, end)
        if samples is None:
            return None
        rates = (samples.angular_velocity[1:] + samples.angular_velocity[:-1]) / 2
        rotation = np.eye(3)
        for turn in so3.exp(rates * np.diff(samples.times)[:, None]):
            rotation = rotation @ turn
        return so3.log(rotation.T)
