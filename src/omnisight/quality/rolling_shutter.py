"""Whether boards moved while the image was read, row by row: a rolling shutter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry.rotation import hat
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# The chance of seeing so much in images in which nothing moves.
CHANCE = 1e-6
# Least part of the squared residuals that motion explains, and least rms of what it explains (px), to be worth a word.
EXPLAINED, MATTERS_PX = 0.3, 0.1
# How many times more (squared) motion along the columns, in which no sensor is read, must leave than along the rows.
TIMES = 1.2
# A pose and its motion have twelve parameters; a view needs twice as many coordinates.
FEWEST_CORNERS = 12


@dataclass(frozen=True)
class RollingShutterTest:
    """What a motion of the boards while the rows were read explains.

    Attributes
    ----------
    explained
        Part of the sum of squared residuals that a steady motion of each board takes away.
    sideways
        The same if columns were read one after the other, as on no sensor: what a poor model gives as well.
    chance
        How likely noise alone explains as much.
    rms
        Of what is explained, px.
    name
        The view of which most is explained.
    """

    explained: float
    sideways: float
    chance: float
    rms: float
    name: str

    @property
    def sentence(self) -> str:
        """Say that a rolling shutter is at work and what to do; empty where it is not."""
        rows = 1 - self.sideways > TIMES * (1 - self.explained)
        if not (rows and self.chance < CHANCE and self.explained > EXPLAINED and self.rms > MATTERS_PX):
            return ""
        return (
            "Residuals go with the row in which a corner was read: motion meanwhile explains"
            f" {self.explained:.0%} of them ({self.rms:.2f} px rms, most in {self.name}). A rolling shutter and a"
            " board or camera that moved: hold both still, or leave out the images that moved (--drop)."
        )


def rolling_shutter(state: State, views: Observations) -> RollingShutterTest | None:
    """Fit each board a motion that is steady while the rows are read, and say what it explains.

    A row v is read at a time t proportional to it. With pose exp(t xi) and a small residual r, r = J (d + t xi), where
    J is the derivative of the pixel by the pose (6), d a change of the pose and xi the motion. What d explains is
    nought after a calibration; whether xi explains more than noise does is the F test of two nested linear models
    (Draper and Smith, Applied Regression Analysis, 1998, ch. 6). Most of a motion looks like another pose, and what is
    left can be the camera model's as well, which knows no rows: so the same is asked of the columns, and rows must do
    better.

    None where no view has enough corners.
    """
    usable = ~ResidualWeights.of(state, views).outliers(state, views) & np.isfinite(state.residuals(views)).all(1)
    points, turned = state.points(views)
    residuals = state.residuals(views)
    with np.errstate(invalid="ignore"):
        _, _, d_point, _ = state.model.project_with_jacobians(points)
    before = rows_left = columns_left = 0.0
    free = parameters = corners = 0
    most, name = 0.0, ""
    for k, group in enumerate(views.groups):
        there = np.flatnonzero(usable[group]) + group.start
        if len(there) < FEWEST_CORNERS:
            continue
        # A rotation w of the board about its origin moves a point by w x turned.
        pose = np.concatenate([d_point[there], -d_point[there] @ hat(turned[there])], axis=2)
        r = residuals[there].ravel()
        along = [_from_minus_half(views.pixels[there, axis]) for axis in (1, 0)]
        still, by_row, by_column = (_left(pose, time, r) for time in (None, *along))
        before, rows_left, columns_left = before + still, rows_left + by_row, columns_left + by_column
        free += 2 * len(there) - 12
        parameters += 6
        if (still - by_row) / len(there) > most:
            most, name = (still - by_row) / len(there), views.names[k]
        corners += len(there)
    if not free or before <= 0:
        return None
    ratio = ((before - rows_left) / parameters) / max(rows_left / free, 1e-300)
    chance = float(fdtrc(parameters, free, ratio))
    rms = float(np.sqrt(max(before - rows_left, 0.0) / corners))
    return RollingShutterTest(1 - rows_left / before, 1 - columns_left / before, chance, rms, name)


def _left(pose: Array, time: Array | None, residuals: Array) -> float:
    """Give the sum of squares that a change of pose (n, 2, 6), and a motion over `time` (n,), leave of (2 n,)."""
    columns = pose if time is None else np.concatenate([pose, time[:, None, None] * pose], axis=2)
    matrix = columns.reshape(-1, columns.shape[2])
    scale = np.linalg.norm(matrix, axis=0)
    matrix = matrix / np.where(scale > 0, scale, 1.0)
    solution, *_ = np.linalg.lstsq(matrix, residuals, rcond=1e-9)
    left = residuals - matrix @ solution
    return float(left @ left)


def _from_minus_half(values: Array) -> Array:
    """Shift and scale so that the least is -1/2 and the greatest 1/2."""
    return (values - values.min()) / max(float(np.ptp(values)), 1e-12) - 0.5
