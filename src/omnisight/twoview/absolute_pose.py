"""Absolute pose of a camera from bearings of known points, some of which are wrong (resection)."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.twoview.bearing_pairs import (
    INITIAL_SIGMA_DEG,
    isotropic_variance,
    tangent_covariances,
    unit_bearings,
    whitening,
)

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AbsolutePose:
    """The estimated pose of a camera; false if none was found.

    Attributes
    ----------
    cam_from_world : Pose or None
        In the unit of the points.
    covariance : (6, 6) array
        Covariance of a step (w, v) of `Pose.moved`, radians and the unit of the points.
    inliers : (N,) array of bool
        Points that are more probably inliers than outliers.
    sigma_deg : float
        Standard deviation of the bearings: the given or the estimated one.
    score : float
        Sum of the squared residuals of the search over their variances, truncated at 11.83 each.
    iterations : int
        Number of samples drawn.
    reason : str
        Why no pose was found; empty otherwise.
    """

    cam_from_world: Pose | None
    covariance: Array = field(repr=False)
    inliers: NDArray[np.bool_] = field(repr=False)
    sigma_deg: float
    score: float
    iterations: int
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether a pose was found."""
        return self.cam_from_world is not None


def resect(
    points: ArrayLike,
    bearings: ArrayLike,
    covariance: ArrayLike | None = None,
    sigma_deg: ArrayLike | None = None,
    options: RansacOptions = RansacOptions(),
) -> AbsolutePose:
    """Estimate the pose of a camera from bearings of known points.

    LO-RANSAC with a P3P solver finds the inliers; the pose is then the maximum-likelihood estimate under a mixture of
    Gaussian noise and outliers. Bearings may have any direction, also behind the camera.

    Parameters
    ----------
    points
        (N, 3) points in the world frame.
    bearings
        (N, 3) their directions in the camera frame.
    covariance
        (N, 3, 3) covariances of the bearings, square radians.
    sigma_deg
        Standard deviation of the bearings, degrees, one or (N,), in place of covariances. Without both, the noise is
        assumed to be isotropic and equal, and is estimated.
    options
        Options of the search, with the seed.

    Raises
    ------
    ValueError
        If arrays have the wrong shape or do not hold directions, finite points and covariances.
    """
    problem = AbsolutePoseProblem.of(points, bearings, covariance, sigma_deg)
    found = estimate_robustly(problem, options)
    sigma = np.sqrt(isotropic_variance(problem.covariance).mean()) if len(problem) else np.nan
    return AbsolutePose(
        found.state,
        np.full((6, 6), np.nan) if found.state is None else found.covariance,
        found.inliers,
        found.scale * float(np.degrees(sigma)),
        found.score,
        found.iterations,
        found.reason,
    )


@dataclass(frozen=True, eq=False)
class AbsolutePoseProblem:
    """The absolute pose of a camera as a problem of `estimate_robustly`.

    Attributes
    ----------
    points, bearings
        (N, 3) points in the world frame, and unit bearings.
    covariance
        (N, 3, 3) covariances of the bearings, square radians; zero along the bearing.
    is_noise_known
        False if the covariances hold only up to a common factor.
    """

    points: Array
    bearings: Array
    covariance: Array
    is_noise_known: bool
    sample_size = 3
    max_solutions = 4
    dimension = 2

    @classmethod
    def of(
        cls, points: ArrayLike, bearings: ArrayLike, covariance: ArrayLike | None, sigma_deg: ArrayLike | None
    ) -> "AbsolutePoseProblem":
        """Check the arrays and normalize the bearings."""
        x, b = np.asarray(points, float), unit_bearings(bearings, "bearings")
        if x.shape != b.shape:
            raise ValueError(f"points must have the shape of the bearings, {b.shape}, got {x.shape}")
        if not np.isfinite(x).all():
            raise ValueError(f"points[{np.flatnonzero(~np.isfinite(x).all(axis=1))[0]}] is not finite")
        if covariance is not None and sigma_deg is not None:
            raise ValueError("give a covariance or sigma_deg, not both")
        known = covariance is not None or sigma_deg is not None
        sigma = INITIAL_SIGMA_DEG if sigma_deg is None else sigma_deg
        return cls(x, b, tangent_covariances(b, covariance, sigma), known)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def compiled(self, order: NDArray[np.intp]) -> Any:
        """Return the problem with isotropic variances."""
        from omnisight.twoview._absolute_pose_kernel import CompiledAbsolutePose

        rows = self.points, self.bearings, isotropic_variance(self.covariance)
        return CompiledAbsolutePose(*(np.ascontiguousarray(row[order]) for row in rows))

    def scaled(self, factor: float) -> "AbsolutePoseProblem":
        """Return the problem with standard deviations multiplied by a factor."""
        return replace(self, covariance=factor**2 * self.covariance)

    def unrelated(self, shift: int) -> "AbsolutePoseProblem":
        """Return the problem with each point and the bearing of another one."""
        return replace(self, bearings=np.roll(self.bearings, shift, 0), covariance=np.roll(self.covariance, shift, 0))

    def state(self, model: Array) -> Pose:
        """Return [R | t] as a pose."""
        return Pose(model[:, :3], model[:, 3])

    @cached_property
    def _whitening(self) -> Array:
        return whitening(self.bearings, self.covariance)

    def linearize(self, state: Pose) -> tuple[Array, Array]:
        """Return the residuals (N, 2) and Jacobians (N, 2, 6)."""
        from omnisight.twoview._absolute_pose_kernel import residuals_and_derivatives

        model = np.column_stack([state.rotation, state.translation])
        arrays = self.points, self.bearings, self._whitening, model
        return residuals_and_derivatives(*map(np.ascontiguousarray, arrays))

    def feature(self, state: Pose) -> Array:
        """Return the distances (N,) from the camera."""
        return np.linalg.norm(state @ self.points, axis=1)

    def retract(self, state: Pose, step: Array) -> Pose:
        """Move a pose."""
        return state.moved(step)
