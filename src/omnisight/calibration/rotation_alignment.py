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

    best = gauss_newton(linearize, np.eye(3), retract=lambda rotation, step: so3.exp(step) @ rotation)
    return difference(best.state)[0]
