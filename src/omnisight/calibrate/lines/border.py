"""What the border of a lens or mirror says of the camera: its middle is nearly the principal point."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines.uncertainty import Uncertainty
from omnisight.models import CameraModel

Array = NDArray[np.float64]

# How far the middle of the border is from the principal point, per axis, as a share of the border's radius: twice the
# 0.4 % (rms) that it is for the four cameras of benchmarks/lines_real.py, for these are few.
ASIDE = 0.009
# Past so many standard deviations lines and border do not agree by chance.
CHANCE = 1.5


def with_border(
    model: CameraModel, uncertainty: Uncertainty, middle: Array, pixels: Array
) -> tuple[CameraModel, Uncertainty]:
    """Take the middle (2,) of the border for a measurement of the principal point, beside what lines told.

    That is the update of Kalman (1960) with the covariance that is stated, in which the lines' common errors are. Where
    the two do not agree, both are said to be less certain by that ratio (Birge 1932). `pixels` (N, 2) are the lines',
    whose farthest stands for the border's radius.
    """
    names = model.param_names
    if not {"cx", "cy"} <= set(names):
        return model, uncertainty
    at = [names.index("cx"), names.index("cy")]
    aside = ASIDE * float(np.linalg.norm(pixels - middle, axis=1).max())
    covariance = uncertainty.covariance
    off = middle - model.params[at]
    both = np.linalg.inv(covariance[np.ix_(at, at)] + aside**2 * np.eye(2))
    gain = covariance[:, at] @ both
    ratio = float(np.sqrt(off @ both @ off / 2))
    combined = dataclasses.replace(uncertainty, covariance=covariance - gain @ covariance[at])
    bounds = np.array([(p.low, p.high) for p in model.parameters]).T
    moved = model.with_params(np.clip(model.params + gain @ off, *bounds))
    return moved, combined if ratio < CHANCE else combined.times(ratio)


def without_centre(freedom: Freedom, model: CameraModel) -> Freedom:
    """Give the freedom in which the principal point stands still."""
    at = [i for i, name in enumerate(model.param_names) if name in ("cx", "cy")]
    still = freedom.directions[at]
    kept = np.linalg.svd(still)[2][np.linalg.matrix_rank(still) :].T
    return dataclasses.replace(freedom, directions=freedom.directions @ kept)
