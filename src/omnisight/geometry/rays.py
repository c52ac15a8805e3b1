"""Rays: the origin and bearing of pixels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Rays(NamedTuple):
    """Half lines in space, one per pixel.

    Attributes
    ----------
    origins
        (..., 3) origins; the camera centre for a central camera. NaN where not valid.
    bearings
        (..., 3) unit vectors. NaN where not valid.
    valid
        (...), whether the pixel has a ray.
    """

    origins: NDArray[np.float64]
    bearings: NDArray[np.float64]
    valid: NDArray[np.bool_]
