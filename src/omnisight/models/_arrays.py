"""Conversion between arrays of any leading shape and rows."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def as_rows(values: ArrayLike, width: int, name: str) -> tuple[Array, tuple[int, ...]]:
    """Return values (..., width) as contiguous (N, width) float64, and their leading shape.

    Raises
    ------
    ValueError
        If the values are not real numbers of that shape; the message contains the name and the shape.
    """
    array = np.asarray(values)
    if array.ndim == 0 or array.shape[-1] != width or array.dtype.kind not in "fiub":
        raise ValueError(
            f"{name} must be real numbers of shape (..., {width}), got shape {array.shape} of {array.dtype}"
        )
    # Writeable: a read-only array is another type to numba, which would compile the loop once more.
    return np.require(array.reshape(-1, width), np.float64, ["C", "W"]), array.shape[:-1]


def with_leading_shape(
    lead: tuple[int, ...], pixels: Array, valid: NDArray[np.bool_], d_point: Array, d_params: Array
) -> tuple[Array, NDArray[np.bool_], Array, Array]:
    """Return the projection of N points and its derivatives in the leading shape of the points; NaN where not valid."""
    if not valid.all():
        for array in (pixels, d_point, d_params):
            array[~valid] = np.nan
    return (
        pixels.reshape(*lead, 2),
        valid.reshape(lead),
        d_point.reshape(*lead, 2, 3),
        d_params.reshape(*lead, 2, d_params.shape[-1]),
    )
