"""Difference between two cameras after the best rotation between their frames."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.models import Projector
from omnisight.optim.gauss_newton import gauss_newton

Array = NDArray[np.float64]


def rotation_aligned_difference(model: Projector, points: Array, pixels: Array) -> Array:
    """Return the difference (N, 2), px, between two cameras after the best rotation between their frames.

    Two calibrations of one camera may define its axis differently. Every pose estimated with either absorbs that
    rotation, so it is no difference between them.

    Parameters
    ----------
    model
        One camera.
    points, pixels
        (N, 3) points or bearings and (N, 2) their pixels in the other camera.

    Returns
    -------
    (N, 2), NaN where the model has no pixel.
    """
    return model.project_with_jacobians(points @ best_rotation(model, points, pixels).T)[0] - pixels


def best_rotation(model: Projector, points: Array, pixels: Array, initial: Array | None = None) -> Array:
    """Return the rotation (3, 3) of points (N, 3) with which a camera projects them nearest to their pixels (N, 2).

    Parameters
    ----------
    model, points, pixels
        As in `rotation_aligned_difference`.
    initial
        (3, 3) rotation from which the search starts; the identity by default.
    """

    def difference(rotation: Array) -> tuple[Array, Array]:
        rotated = points @ rotation.T
        projected, _, d_point, _ = model.project_with_jacobians(rotated)
        # The scene, rotated by w, lies at b + w x b.
        return projected - pixels, -d_point @ so3.hat(rotated)

    def linearize(rotation: Array) -> tuple[Array, Array]:
        residuals, jacobian = difference(rotation)
        use = np.asarray(np.isfinite(residuals).all(1) & np.isfinite(jacobian).all((1, 2)))
        return np.where(use[:, None], residuals, 0.0).ravel(), np.where(use[:, None, None], jacobian, 0.0).reshape(
            -1, 3
        )

    start = np.eye(3) if initial is None else initial
    return gauss_newton(linearize, start, retract=lambda rotation, step: so3.exp(step) @ rotation).state
