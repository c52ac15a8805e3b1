"""Corners past the rim of a camera's domain, held at it: so the cost goes on where the domain ends.

If they cost some fixed length instead, the cost would jump where the rim passes a corner, and hold a camera there: the
more so as wrong corners lie anywhere.
"""

import numpy as np
from numpy.typing import NDArray

from omnisight.models import CameraModel

Array = NDArray[np.float64]

# Of the rim's angle: on the rim itself a projection may be infinite.
INSIDE = 1 - 1e-7


def held(model: CameraModel, points: Array) -> tuple[Array, Array]:
    """Give the bearings (N, 3) on the rim that lie in the directions of points (N, 3), and what they change by.

    That is (N, 3, 3), d bearing / d point: a point that moves on from the axis stays where it is held. Where the rim is
    where the image stops growing, it moves with the parameters as the image of the bearing does (the envelope theorem).
    """
    rim = INSIDE * model.rim
    radius = np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-300)
    cosine, sine = points[:, 0] / radius, points[:, 1] / radius
    zero = np.zeros_like(radius)
    bearings = np.stack([np.sin(rim) * cosine, np.sin(rim) * sine, zero + np.cos(rim)], -1)
    around = np.stack([-sine, cosine, zero], -1)
    return bearings, (np.sin(rim) / radius)[:, None, None] * around[:, :, None] * around[:, None, :]
