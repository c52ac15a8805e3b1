"""Triangulation: points from two or more rays of cameras with known poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.twoview.bearing_pairs import INITIAL_SIGMA_DEG, tangent_covariances

Array = NDArray[np.float64]

# Parallax in units of its standard deviation below which the distance of a point is unknown.
MIN_PARALLAX_SIGMA = 3.0


@dataclass(frozen=True, eq=False)
class Triangulation(Displayed):
    """Triangulated points.

    Attributes
    ----------
    points : (N, 3) array
        In the world frame; NaN with fewer than two rays, or for parallel rays.
    covariance : (N, 3, 3) array
        Covariances of the points; NaN where they are.
    valid : (N,) array of bool
        Whether the point has positive distances along all its rays, and a parallax above three times its standard
        deviation.
    parallax_deg : (N,) array
        Largest angle between two rays of a point.
    residual_deg : (N,) array
        Root mean square angle between the rays and the directions of the point.
    """

    points: Array
    covariance: Array = field(repr=False)
    valid: NDArray[np.bool_] = field(repr=False)
    parallax_deg: Array = field(repr=False)
    residual_deg: Array = field(repr=False)


def triangulate(
    cam_from_world: Sequence[Pose],
    bearings: ArrayLike,
    covariance: ArrayLike | None = None,
    sigma_deg: float | None = None,
    origins: ArrayLike | None = None,
) -> Triangulation:
    """Triangulate points from the bearings of two or more cameras.

    The points minimize the sum of the squared angles between bearings and points, weighted by covariances: the
    optimum of S. Lee and J. Civera, Closed-form optimal two-view triangulation based on angular errors, ICCV 2019, for
    any number of rays, computed iteratively from the point nearest to the rays. Bearings may have any direction.

    Parameters
    ----------
    cam_from_world
        V poses.
    bearings
        (V, N, 3) directions of N points in the camera frames; NaN where a camera does not see a point.
    covariance
        (V, N, 3, 3) covariances of the bearings, square radians.
    sigma_deg
        Standard deviation of all bearings, degrees, in place of covariances. Without both, it is estimated from the
        residuals of all points.
    origins
        (V, N, 3) origins of the rays in the camera frames, for cameras without a single viewpoint; zero by default.

    Raises
    ------
    ValueError
        If the shapes do not agree.
    """
    seen, rays = _world_rays(cam_from_world, bearings, origins)
    origin, direction, rotations = rays
    directions_in_cams = np.where(seen[..., None], np.asarray(bearings, float), [0.0, 0.0, 1.0])
    directions_in_cams /= np.linalg.norm(directions_in_cams, axis=-1, keepdims=True)
    known = covariance is not None or sigma_deg is not None
    across = _whitening(directions_in_cams, covariance, INITIAL_SIGMA_DEG if sigma_deg is None else sigma_deg, seen)
    maps = np.ascontiguousarray(np.einsum("vnkj,vji->nvki", across, rotations))

    from omnisight.twoview._triangulation_kernel import angular_optimum, largest_angles, midpoints

    points, cost, information = angular_optimum(midpoints(origin, direction), origin, direction, maps)
    count = seen.sum(axis=0)
    scale = 1.0 if known else _scale(cost, count)
    finite = np.isfinite(points[:, 0])
    covariances = np.full((len(points), 3, 3), np.nan)
    covariances[finite] = scale**2 * _inverses(information[finite])
    offset = points[:, None] - origin
    distance = np.linalg.norm(offset, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = (offset * direction).sum(-1)
        angle = 2 * np.arcsin(np.minimum(np.linalg.norm(offset / distance[..., None] - direction, axis=-1) / 2, 1))
        residual = np.sqrt(np.nansum(angle**2, axis=1) / np.maximum(count, 1))
    parallax = largest_angles(direction)
    information_of_rays = np.where(seen.T, (maps**2).sum(axis=(2, 3)) / 2, 0.0).sum(axis=1) / np.maximum(count, 1)
    with np.errstate(divide="ignore"):
        sigma = scale / np.sqrt(information_of_rays)
    is_ahead = np.where(seen.T, along > 0, True).all(axis=1)
    valid = finite & is_ahead & (parallax > MIN_PARALLAX_SIGMA * np.sqrt(2) * sigma)
    return Triangulation(points, covariances, valid, np.degrees(parallax), np.degrees(residual))


def _world_rays(
    cam_from_world: Sequence[Pose], bearings: ArrayLike, origins: ArrayLike | None
) -> tuple[NDArray[np.bool_], tuple[Array, Array, Array]]:
    """Return which rays exist (V, N), their origins and directions (N, V, 3) in the world, and rotations (V, 3, 3)."""
    if wrong := [pose for pose in cam_from_world if not isinstance(pose, Pose)]:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ValueError(f"cam_from_world must hold poses (omnisight.Pose), got {type(wrong[0]).__name__}")
    b = np.asarray(bearings, float)
    if b.ndim != 3 or b.shape[2] != 3 or len(b) != len(cam_from_world) or len(b) < 2:
        raise ValueError(
            f"bearings must have the shape (V, N, 3) with V >= 2 poses, got {b.shape} and {len(cam_from_world)} poses"
        )
    o = np.zeros_like(b) if origins is None else np.asarray(origins, float)
    if o.shape != b.shape:
        raise ValueError(f"origins must have the shape of the bearings, {b.shape}, got {o.shape}")
    rotations = np.stack([pose.rotation for pose in cam_from_world])
    translations = np.stack([pose.translation for pose in cam_from_world])
    length = np.linalg.norm(b, axis=-1)
    seen = np.isfinite(length) & (length > 0) & np.isfinite(o).all(axis=-1)
    unit = np.where(seen[..., None], b, np.nan) / np.where(seen, length, 1.0)[..., None]
    direction = np.einsum("vnj,vji->nvi", unit, rotations)
    origin = np.einsum("vnj,vji->nvi", o - translations[:, None], rotations)
    return seen, (np.ascontiguousarray(origin), np.ascontiguousarray(direction), rotations)


def whitening(covariance: Array) -> Array:
    """Return the maps (N, 2, 3) of chords to two components of unit variance, given covariances (N, 3, 3).

    The covariances are zero along the bearings.
    """
    from omnisight.twoview._triangulation_kernel import whitening_maps

    return whitening_maps(np.ascontiguousarray(covariance))


def _whitening(bearings: Array, covariance: ArrayLike | None, sigma_deg: float, seen: NDArray[np.bool_]) -> Array:
    """Return the maps (V, N, 2, 3) of chords in the camera frames to two components of unit variance."""
    views, count = bearings.shape[:2]
    flat = bearings.reshape(-1, 3)
    if covariance is not None:
        given = np.asarray(covariance, float)
        if given.shape != (views, count, 3, 3):
            raise ValueError(f"covariance must have the shape ({views}, {count}, 3, 3), got {given.shape}")
        if not np.isfinite(given[seen]).all():
            raise ValueError("the covariance of a bearing that a camera sees is not finite")
        covariance = np.where(seen[..., None, None], given, np.eye(3)).reshape(-1, 3, 3)
    return whitening(tangent_covariances(flat, covariance, sigma_deg)).reshape(views, count, 2, 3)


def _inverses(information: Array) -> Array:
    """Return the inverses of informations (N, 3, 3); a direction without any has a large variance."""
    least = np.finfo(float).eps * np.trace(information, axis1=1, axis2=2)
    return np.linalg.inv(information + least[:, None, None] * np.eye(3))


def _scale(cost: Array, count: NDArray[np.intp]) -> float:
    """Return the standard deviation of the residuals; a point with V rays has 2 V - 3 more of them than coordinates."""
    use = np.isfinite(cost)
    freedom = int((2 * count[use] - 3).sum())
    return float(np.sqrt(cost[use].sum() / freedom)) if freedom > 0 else float("nan")
