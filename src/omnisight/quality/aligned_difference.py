"""How far two cameras differ, when poses found with them may take up what they can."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel

Array = NDArray[np.float64]

TURNS = 5


def rotation_aligned_difference(model: CameraModel, bearings: Array, pixels: Array) -> Array:
    """Give by how much (N, 2), px, a camera sees bearings beside pixels, its frame turned to fit best.

    Two calibrations of one camera may place its axis differently: what that moves is no difference between them, since
    every pose found with either takes it up.

    Parameters
    ----------
    model
        The camera.
    bearings, pixels
        (N, 3) directions and (N, 2) where another camera sees them.

    Returns
    -------
    (N, 2), NaN where the camera sees nothing.
    """
    turn = np.eye(3)
    off = np.full(pixels.shape, np.nan)
    for _ in range(TURNS):
        turned = bearings @ turn.T
        seen, _, d_point, _ = model.project_with_jacobians(turned)
        off = seen - pixels
        # The scene, turned by w, is at b + w x b.
        effect = -d_point @ so3.hat(turned)
        use = np.isfinite(off).all(1) & np.isfinite(effect).all((1, 2))
        step = -np.linalg.lstsq(effect[use].reshape(-1, 3), off[use].ravel(), rcond=None)[0]
        turn = so3.exp(step) @ turn
    return off
