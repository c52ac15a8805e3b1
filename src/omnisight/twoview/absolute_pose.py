"""Absolute pose of a camera from bearings of known points, some of which are wrong (resection)."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.geometry.rays import Rays
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.ray_camera import RayCamera
from omnisight.twoview.bearing_pairs import INITIAL_SIGMA_DEG, isotropic_variance, tangent_covariances, unit_bearings

Array = NDArray[np.float64]

# Step of the central differences of bearings, px.
SLOPE_STEP_PX = 0.01
# Estimates for a non-central camera, each of which divides the error by about distance / pupil shift, and the change of
# the pose, relative to the distance, at which they end.
MAX_RAY_ITERATIONS, RAY_TOLERANCE = 10, 1e-7


@dataclass(frozen=True, eq=False)
class AbsolutePose(Displayed):
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
    observed: ArrayLike,
    covariance: ArrayLike | None = None,
    sigma_deg: ArrayLike | None = None,
    seed: int = 0,
    *,
    camera: Camera | RayCamera | None = None,
) -> AbsolutePose:
    """Estimate the pose of a camera from points (N, 3) and their pixels (N, 2) or bearings (N, 3).

    `omnisight.resect` describes the parameters and the method; here a camera is not a file.
    """
    options = RansacOptions(seed=seed)
    if camera is None:
        x, b, cov = _checked(points, observed, covariance, sigma_deg)
        return _estimate(x, b, cov, covariance is not None or sigma_deg is not None, options)
    if sigma_deg is not None:
        raise ValueError("sigma_deg is for bearings: give the covariance of the pixels, px^2")
    x, rays, cov = _rays_of_pixels(points, observed, covariance, camera)
    use, seen = np.flatnonzero(rays.valid), rays.bearings
    found = _estimate(x[use], seen[use], cov[use], covariance is not None, options)
    for _ in range(0 if isinstance(camera, Camera) else MAX_RAY_ITERATIONS):
        if found.cam_from_world is None:
            break
        before = found.cam_from_world
        distance = np.linalg.norm(before @ x - rays.origins, axis=1, keepdims=True)
        seen = rays.origins + distance * rays.bearings
        found = _estimate(x[use], seen[use], cov[use], covariance is not None, options)
        if found.cam_from_world is not None and _is_same(before, found.cam_from_world):
            break
    inliers = np.zeros(len(x), np.bool_)
    inliers[use] = found.inliers
    return replace(found, inliers=inliers)


def _estimate(x: Array, bearings: Array, cov: Array, is_scale_known: bool, options: RansacOptions) -> AbsolutePose:
    """Estimate the pose from points (N, 3), bearings (N, 3) of any length, and covariances (N, 3, 3)."""
    from omnisight.twoview._absolute_pose_kernel import AbsolutePoseProblem

    b = bearings / np.linalg.norm(bearings, axis=1, keepdims=True)
    variance = isotropic_variance(cov)
    found = estimate_robustly(
        lambda scale: AbsolutePoseProblem(x, b, scale**2 * cov, scale**2 * variance),
        is_scale_known=is_scale_known,
        options=options,
    )
    sigma = float(np.degrees(np.sqrt(variance.mean()))) if len(b) else float("nan")
    pose, covariance_of_step = None, np.full((6, 6), np.nan)
    reason = found.reason or found.ambiguity
    if found.model is not None and not reason:
        pose, covariance_of_step = Pose.of_matrix(found.model), found.covariance
    search = found.score, found.iterations, reason
    return AbsolutePose(pose, covariance_of_step, found.inliers, found.scale * sigma, *search)


def _rays_of_pixels(
    points: ArrayLike, pixels: ArrayLike, covariance: ArrayLike | None, camera: Camera | RayCamera
) -> tuple[Array, Rays, Array]:
    """Check the arrays; return points, the rays of the pixels, and the covariances (N, 3, 3) of their bearings."""
    x, p = np.array(points, float), np.array(pixels, float)
    if x.ndim != 2 or x.shape[1] != 3 or p.shape != (len(x), 2):
        raise ValueError(f"needs points (N, 3) and pixels (N, 2), got shapes {x.shape} and {p.shape}")
    if not np.isfinite(x).all():
        raise ValueError(f"points[{np.flatnonzero(~np.isfinite(x).all(axis=1))[0]}] is not finite")
    given = np.eye(2) if covariance is None else np.asarray(covariance, float)
    if given.shape not in ((2, 2), (len(x), 2, 2)):
        raise ValueError(f"the covariance of pixels must be ({len(x)}, 2, 2) or (2, 2), got shape {given.shape}")
    if not (np.isfinite(given).all() and (np.linalg.eigvalsh(given) > 0).all()):
        raise ValueError("a covariance of the pixels is not positive definite")
    rays = camera.rays(p)
    d_pixel = np.stack([_bearing_slope(camera, p, axis) for axis in np.eye(2)], -1)
    known = rays.valid & np.isfinite(d_pixel).all((1, 2))
    d_pixel = np.where(known[:, None, None], d_pixel, 0.0)
    return x, rays._replace(valid=known), d_pixel @ given @ np.swapaxes(d_pixel, 1, 2)


def _bearing_slope(camera: Camera | RayCamera, pixels: Array, axis: Array) -> Array:
    """Return the derivative (N, 3) of the bearings of pixels along an axis, by central differences."""
    after, before = (camera.rays(pixels + sign * SLOPE_STEP_PX * axis).bearings for sign in (1, -1))
    return (after - before) / (2 * SLOPE_STEP_PX)


def _is_same(a: Pose, b: Pose) -> bool:
    """Return whether two poses differ by less than the accuracy of the iteration."""
    shift = np.linalg.norm(a.translation - b.translation)
    size = max(float(np.linalg.norm(b.translation)), 1e-12)
    return bool(shift < RAY_TOLERANCE * size and np.abs(a.rotation - b.rotation).max() < RAY_TOLERANCE)


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
