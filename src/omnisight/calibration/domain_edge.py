"""Corners past the rim of a camera's domain, project_clamped at it: so the cost goes on where the domain ends.

If they cost some fixed length instead, the cost would jump where the rim passes a corner, and hold a camera there: the
more so as wrong corners lie anywhere.
"""

import numpy as np
from numpy.typing import NDArray

from omnisight.models import CameraModel

Array = NDArray[np.float64]

# Of the rim's angle: on the rim itself a projection may be infinite.
INSIDE = 1 - 1e-7
# px by which corners move in the steps that tell how a rim moves.
STEP = 1e-2
# A pixel on the rim that changes so many times more than any other has a slope that is infinite.
STEEP = 30.0


def project_clamped(model: CameraModel, points: Array) -> Array:
    """Give the pixels (N, 2) of the bearings on the rim that lie in the directions of points (N, 3)."""
    return model.project_numpy(_on_rim(model, points))[0]


def project_clamped_jacobians(model: CameraModel, points: Array, d_params: Array) -> tuple[Array, Array]:
    """Give the derivatives of these pixels: by point (N, 2, 3) and by parameters (N, 2, P).

    A point that moves on from the axis stays where it is clamped. `d_params` (M, 2, P) of points that the model sees say
    how large a step of each parameter is.
    """
    if not len(points):
        return np.empty((0, 2, 3)), np.empty((0, 2, model.params.size))
    bearings = _on_rim(model, points)
    pixels, _, d_bearing, by_params = model.project_with_jacobians(bearings)
    by_azimuth = d_bearing @ _around(bearings)[:, :, None]
    d_azimuth = _around(points) / _radius(points)[:, None] ** 2
    # Where an image stops growing, or is cut off, its rim moves with the parameters as the images of its bearings do
    # (the envelope theorem). Where angles stop growing these run away, and only steps tell.
    most = np.nanmax(np.abs(d_params), axis=(0, 1), initial=0.0)
    for i in np.flatnonzero(~(np.abs(by_params) <= STEEP * most).all((0, 1))):
        step = STEP / most[i] if most[i] > 0 else 0.0
        moved = project_clamped(model.with_params(model.params + step * np.eye(len(most))[i]), points)
        by_params[..., i] = (moved - pixels) / STEP * most[i]
    return by_azimuth * d_azimuth[:, None, :], by_params


def _on_rim(model: CameraModel, points: Array) -> Array:
    rim, radius = INSIDE * model.rim, _radius(points)
    flat = np.sin(rim) / radius
    return np.stack([flat * points[:, 0], flat * points[:, 1], np.full_like(radius, np.cos(rim))], -1)


def _radius(points: Array) -> Array:
    """Give the distances (N,) from the axis."""
    return np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-150)


def _around(points: Array) -> Array:
    """Give what points (N, 3) change by as they turn about the axis."""
    return np.stack([-points[:, 1], points[:, 0], np.zeros(len(points))], -1)
