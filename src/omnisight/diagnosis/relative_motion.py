"""Relative poses of two images of a recording, and a parameter of the camera that all of them share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.diagnosis.frame_pairs import SeenFrame
from omnisight.geometry import rotation as so3
from omnisight.optim.ransac import RansacOptions
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose
from omnisight.visual_odometry.ray_observations import FrameRays, common

Array = NDArray[np.float64]

MAX_SAMPLES = 500
# Correspondences of a pair: a step of the pose and a parameter of the camera have six parameters.
MIN_INLIERS = 30


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """The relative pose of two images, with the rays (N) that agree with it.

    Attributes
    ----------
    first, second
        The rays.
    model
        (3, 4) relative pose.
    is_rotation
        Whether the camera only turned.
    seconds
        Time between the images.
    """

    first: FrameRays
    second: FrameRays
    model: Array
    is_rotation: bool
    seconds: float

    @property
    def rate(self) -> Array:
        """Turn rate (3,), radians per second."""
        return so3.log(self.model[:, :3]) / self.seconds

    @classmethod
    def of(cls, a: SeenFrame, b: SeenFrame) -> Self | None:
        """Estimate the relative pose; None if there is none."""
        first, second = common(a.rays, b.rays)
        pairs = BearingPairs(first.bearings, second.bearings, first.covariance, second.covariance, is_noise_known=False)
        found = estimate_relative_pose(pairs, RansacOptions(max_iterations=MAX_SAMPLES))
        if found.b_from_a is None or found.inliers.sum() < MIN_INLIERS:
            return None
        used, is_rotation = found.inliers, found.motion.name == "rotation only"
        return cls(first[used], second[used], found.b_from_a.matrix, is_rotation, b.seconds - a.seconds)

    def parameter(self, first: FrameRays, second: FrameRays, step: float) -> list[tuple[float, float]]:
        """Return a parameter of the camera with its standard deviation, by least squares together with the pose.

        Empty if the rays do not determine it.

        Parameters
        ----------
        first, second
            The rays (N) that the camera has if the parameter is `step` instead of zero.
        """
        residuals, jacobian = self._linearized(self.first, self.second)
        columns = np.column_stack([jacobian, (self._linearized(first, second)[0] - residuals) / step])
        use = np.isfinite(columns).all(axis=1) & np.isfinite(residuals)
        r, columns = residuals[use], columns[use]
        solution = -np.linalg.lstsq(columns, r, rcond=None)[0]
        variance = float(((r + columns @ solution) ** 2).sum()) / max(len(r) - columns.shape[1], 1)
        covariance = variance * np.linalg.pinv(columns.T @ columns, hermitian=True)
        sigma = float(np.sqrt(covariance[-1, -1]))
        return [(float(solution[-1]), sigma)] if 0 < sigma < np.inf else []

    def _linearized(self, first: FrameRays, second: FrameRays) -> tuple[Array, Array]:
        """Return whitened residuals (M,), and derivatives (M, P) by a step of the pose, for other rays (N)."""
        from omnisight.optim._robust_problem_kernel import linearized
        from omnisight.twoview._alignment_problems_kernel import RotationProblem
        from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

        covariances = first.covariance, second.covariance
        pairs = BearingPairs(first.bearings, second.bearings, *covariances, is_noise_known=False)
        kind = RotationProblem if self.is_rotation else RelativePoseProblem
        residuals, jacobian = linearized(kind.of(pairs), self.model)
        return residuals.ravel(), jacobian.reshape(residuals.size, -1)


def weighted_mean(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of values with standard deviations, and its own, which includes the scatter of the values."""
    values, sigmas = np.array(found).T
    weights = 1.0 / sigmas**2
    mean = float((weights * values).sum() / weights.sum())
    excess = max(float(((values - mean) ** 2 * weights).sum()) / (len(values) - 1), 1.0)
    return mean, float(np.sqrt(excess / weights.sum()))
