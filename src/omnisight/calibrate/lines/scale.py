"""What lines do not tell: tan(theta) -> k tan(theta) keeps every great circle a great circle."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.models import CameraModel

Array = NDArray[np.float64]

# What is not the shape of r(theta): a model with more than one number beside them bends freely.
NO_SHAPE = {"fx", "fy", "cx", "cy", "skew", "c", "d", "e"}

# What the shape of real lenses and mirrors takes from the scale, as a share of it. Perfect images of lines through
# eight board calibrations give 1 % in the median and 4 % rms (`python -m benchmarks.lines shapes`), the rows of real
# boards 2.5 %.
SHAPE = 0.04


def scale_deviation(model: CameraModel, pixels: Array) -> float:
    """Give what `SHAPE` makes of the bearings of pixels (N, 2), radians, rms: sin(theta) cos(theta) each."""
    bearings, valid = model.unproject_numpy(pixels)
    b = bearings[valid]
    return SHAPE * float(np.sqrt((b[:, 2] ** 2 * (1 - b[:, 2] ** 2)).mean())) if len(b) else np.inf


def bends_freely(model: CameraModel) -> bool:
    """Say whether a model has so many numbers for its shape that it follows a change of scale."""
    return len(set(model.param_names) - NO_SHAPE) > 1


def without_scale(freedom: Freedom, model: CameraModel, pixels: Array) -> Freedom:
    """Give the freedom without the combination of parameters that scales tan(theta) where the pixels (N, 2) are.

    A bearing b moves with k as t = b_z (e_z - b_z b), and with the parameters by D. Scaling is what has a share along
    t, so steps x with sum t^T D x = 0 are left. No one parameter would do in its place: where no line comes near the
    axis, a focal length there is held by nothing, and holds nothing.
    """
    bearings, valid, _, d_params = model.unproject_with_jacobians(pixels)
    valid &= np.isfinite(d_params).all((1, 2))
    b = bearings[valid]
    slopes = d_params[valid] @ freedom.directions
    scaling = b[:, 2:] * (np.array([0.0, 0.0, 1.0]) - b[:, 2:] * b)
    # Parameters of very different size (px, px^-3): each by what it does to the bearings.
    unit = 1 / np.maximum(np.sqrt((slopes**2).sum((0, 1))), 1e-300)
    share = np.einsum("ni,niq->q", scaling, slopes) * unit
    kept = np.linalg.svd(share[None])[2][1:].T
    return dataclasses.replace(freedom, directions=freedom.directions @ (unit[:, None] * kept))
