"""Rolling shutter test: whether boards moved while the rows of an image were read one after the other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.geometry.rotation import hat
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Significance level of the F test: a false alarm in a million calibrations.
SIGNIFICANCE = 1e-6
# Share of the squared residuals, and rms (px), that motion must explain to matter.
MIN_EXPLAINED, MIN_EXPLAINED_PX = 0.3, 0.1
# Ratio of the squared residuals after motion along columns, which no sensor has, to those after motion along rows.
MIN_ROW_ADVANTAGE = 1.2
# Corners of a view: a pose and its motion have twelve parameters, and a corner two coordinates.
MIN_CORNERS = 12
# Relative singular value below which a motion is degenerate with the pose.
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True)
class RollingShutterTest:
    """How much of the residuals a constant motion of each board during the readout explains.

    Attributes
    ----------
    explained
        Share of the squared residuals explained by motion if rows are read one after the other.
    explained_by_columns
        The same if columns were read one after the other, as on no sensor: what a poor camera model explains too.
    p_value
        Probability that noise alone explains as much.
    rms
        Root mean square of the explained part, px.
    name
        The view of which most is explained.
    """

    explained: float
    explained_by_columns: float
    p_value: float
    rms: float
    name: str

    @property
    def is_positive(self) -> bool:
        """Whether motion along the rows explains the residuals significantly and relevantly."""
        rows_are_better = 1 - self.explained_by_columns > MIN_ROW_ADVANTAGE * (1 - self.explained)
        relevant = self.explained > MIN_EXPLAINED and self.rms > MIN_EXPLAINED_PX
        return rows_are_better and relevant and self.p_value < SIGNIFICANCE

    @property
    def sentence(self) -> str:
        """Finding and action; empty if the test is negative."""
        if not self.is_positive:
            return ""
        return (
            f"Motion during a rolling-shutter readout explains {self.explained:.0%} of the squared residuals"
            f" ({self.rms:.2f} px rms, most in {self.name}): hold board and camera still, or leave out the images with"
            " motion (--drop)."
        )


def run_rolling_shutter_test(state: State, observations: Observations) -> RollingShutterTest | None:
    """Fit each board a constant motion during the readout and test how much it explains.

    Row v is read at a time t proportional to v. With the pose exp(t xi) and a small residual r, r = J (d + t xi), where
    J is the derivative of the pixel by the pose (6), d a change of the pose and xi the motion. Whether xi explains more
    than noise does is the F test of two nested linear models (Draper and Smith, Applied Regression Analysis, 1998, ch.
    6). Most of a motion is equivalent to another pose, and the rest may be an error of the camera model, which does not
    depend on rows; so the same is done for columns, and rows must explain more.

    None if no view has enough corners.
    """
    residuals = state.residuals(observations)
    outliers = ResidualWeights.estimate(state, observations).outliers(state, observations)
    usable = ~outliers & np.isfinite(residuals).all(1)
    points, rotated = state.points(observations)
    with np.errstate(invalid="ignore"):
        _, _, d_point, _ = state.model.project_with_jacobians(points)
    static = by_rows = by_columns = largest = 0.0
    degrees, parameters, corners, name = 0, 0, 0, ""
    for k, group in enumerate(observations.groups):
        rows = np.flatnonzero(usable[group]) + group.start
        if len(rows) < MIN_CORNERS:
            continue
        # A rotation w of the board about its origin moves a point by w x rotated.
        pose = np.concatenate([d_point[rows], -d_point[rows] @ hat(rotated[rows])], axis=2)
        r = residuals[rows].ravel()
        times = [None, *(_readout_time(observations.pixels[rows, axis]) for axis in (1, 0))]
        of_view, rows_left, columns_left = (_remaining_squares(pose, time, r) for time in times)
        static, by_rows, by_columns = static + of_view, by_rows + rows_left, by_columns + columns_left
        degrees += 2 * len(rows) - 12
        parameters += 6
        corners += len(rows)
        if (of_view - rows_left) / len(rows) > largest:
            largest, name = (of_view - rows_left) / len(rows), observations.names[k]
    if not degrees or static <= 0:
        return None
    ratio = ((static - by_rows) / parameters) / max(by_rows / degrees, 1e-300)
    p_value = float(fdtrc(parameters, degrees, ratio))
    rms = float(np.sqrt(max(static - by_rows, 0.0) / corners))
    return RollingShutterTest(1 - by_rows / static, 1 - by_columns / static, p_value, rms, name)


def _remaining_squares(pose: Array, time: Array | None, residuals: Array) -> float:
    """Return the squared residuals (2 n,) after a change of pose (n, 2, 6) and, if there are times (n,), a motion."""
    columns = pose if time is None else np.concatenate([pose, time[:, None, None] * pose], axis=2)
    matrix = columns.reshape(-1, columns.shape[2])
    scale = np.linalg.norm(matrix, axis=0)
    matrix = matrix / np.where(scale > 0, scale, 1.0)
    solution, *_ = np.linalg.lstsq(matrix, residuals, rcond=RANK_TOLERANCE)
    remaining = residuals - matrix @ solution
    return float(remaining @ remaining)


def _readout_time(values: Array) -> Array:
    """Return the coordinates scaled to [-1/2, 1/2]."""
    return (values - values.min()) / max(float(np.ptp(values)), 1e-12) - 0.5
