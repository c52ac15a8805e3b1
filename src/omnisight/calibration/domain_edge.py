"""Projection of points outside a camera's domain, clamped to its edge for a continuous cost.

With a constant cost outside, the total would jump where the edge passes a corner, and optimization would stop there.
"""

import numpy as np
from numpy.typing import NDArray

from omnisight.models import Projector

Array = NDArray[np.float64]

# Factor of the angle of the edge at which points are clamped: at the edge itself a projection may be infinite.
CLAMP_FACTOR = 1 - 1e-7
# Change of the pixels (px) in the finite differences by parameters.
DIFFERENCE_PX = 1e-2
# Ratio to the largest derivative inside the domain above which one at the edge is taken as infinite.
MAX_DERIVATIVE_RATIO = 30.0
# Least distance from the axis, to avoid a division by 0.
MIN_RADIUS = 1e-150


def project_clamped(model: Projector, points: Array) -> Array:
    """Return the pixels (N, 2) of the bearings at the edge of the domain with the azimuths of points (N, 3)."""
    return model.project_numpy(_clamp(model, points))[0]


def project_clamped_jacobians(model: Projector, points: Array, d_params: Array) -> tuple[Array, Array]:
    """Return the derivatives of the clamped pixels by point (N, 2, 3) and by parameters (N, 2, P).

    A clamped pixel does not depend on the off-axis angle of its point. `d_params` (M, 2, P), the derivatives of points
    inside the domain, sets the scale of each parameter.
    """
    if not len(points):
        return np.empty((0, 2, 3)), np.empty((0, 2, model.params.size))
    bearings = _clamp(model, points)
    pixels, _, d_bearing, by_params = model.project_with_jacobians(bearings)
    by_azimuth = d_bearing @ _d_azimuth(bearings)[:, :, None]
    d_azimuth = _d_azimuth(points) / _axis_distance(points)[:, None] ** 2
    # Where the image stops growing or is cut off, the edge moves with the parameters as the pixels of its bearings do
    # (envelope theorem). Where the angle stops growing, these derivatives diverge: use finite differences there.
    largest = np.nanmax(np.abs(d_params), axis=(0, 1), initial=0.0)
    for i in np.flatnonzero(~(np.abs(by_params) <= MAX_DERIVATIVE_RATIO * largest).all((0, 1))):
        step = DIFFERENCE_PX / largest[i] if largest[i] > 0 else 0.0
        moved = project_clamped(model.with_params(model.params + step * np.eye(len(largest))[i]), points)
        by_params[..., i] = (moved - pixels) / DIFFERENCE_PX * largest[i]
    return by_azimuth * d_azimuth[:, None, :], by_params


def _clamp(model: Projector, points: Array) -> Array:
    """Return the bearings (N, 3) at the edge of the domain with the azimuths of the points."""
    theta, distance = CLAMP_FACTOR * model.rim, _axis_distance(points)
    scale = np.sin(theta) / distance
    return np.stack([scale * points[:, 0], scale * points[:, 1], np.full_like(distance, np.cos(theta))], -1)


def _axis_distance(points: Array) -> Array:
    """Return the distances (N,) of points from the optical axis."""
    return np.maximum(np.hypot(points[:, 0], points[:, 1]), MIN_RADIUS)


def _d_azimuth(points: Array) -> Array:
    """Return the derivatives (N, 3) of points by their azimuth."""
    return np.stack([-points[:, 1], points[:, 0], np.zeros(len(points))], -1)
