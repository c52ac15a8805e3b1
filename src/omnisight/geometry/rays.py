"""Rays: what a pixel sees along, from where."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Rays(NamedTuple):
    """Half lines in space, one for each pixel asked for.

    Attributes
    ----------
    origins
        (..., 3) where they begin; the camera's centre if it is central. NaN where not valid.
    bearings
        (..., 3) unit vectors along which light is seen. NaN where not valid.
    valid
        (...), whether the pixel sees anything.
    """

    origins: NDArray[np.float64]
    bearings: NDArray[np.float64]
    valid: NDArray[np.bool_]
