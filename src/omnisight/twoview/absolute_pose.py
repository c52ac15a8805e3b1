"""Absolute pose of a camera from bearings of known points, some of which are wrong (resection)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.twoview.bearing_pairs import INITIAL_SIGMA_DEG, isotropic_variance, tangent_covariances, unit_bearings

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
    from omnisight.twoview._absolute_pose_kernel import AbsolutePoseProblem

    x, b, cov = _checked(points, bearings, covariance, sigma_deg)
    variance = isotropic_variance(cov)
    found = estimate_robustly(
        lambda scale: AbsolutePoseProblem(x, b, scale**2 * cov, scale**2 * variance),
        is_scale_known=covariance is not None or sigma_deg is not None,
        options=options,
    )
    sigma = float(np.degrees(np.sqrt(variance.mean()))) if len(b) else float("nan")
    pose, covariance_of_step = None, np.full((6, 6), np.nan)
    if found.model is not None:
        pose, covariance_of_step = Pose.of_matrix(found.model), found.covariance
    search = found.score, found.iterations, found.reason
    return AbsolutePose(pose, covariance_of_step, found.inliers, found.scale * sigma, *search)


def _checked(
    points: ArrayLike, bearings: ArrayLike, covariance: ArrayLike | None, sigma_deg: ArrayLike | None
) -> tuple[Array, Array, Array]:
    """Check the arrays; return points, unit bearings, and covariances (N, 3, 3) in their tangent planes."""
    x, b = np.array(points, float), unit_bearings(bearings, "bearings")
    if x.shape != b.shape:
        raise ValueError(f"points must have the shape of the bearings, {b.shape}, got {x.shape}")
    if not np.isfinite(x).all():
        raise ValueError(f"points[{np.flatnonzero(~np.isfinite(x).all(axis=1))[0]}] is not finite")
    if covariance is not None and sigma_deg is not None:
        raise ValueError("give a covariance or sigma_deg, not both")
    sigma = INITIAL_SIGMA_DEG if sigma_deg is None else sigma_deg
    return x, b, tangent_covariances(b, covariance, sigma)
