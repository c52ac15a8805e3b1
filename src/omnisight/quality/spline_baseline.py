"""Spline baseline: a spline camera fits any lens, so its held-out error shows the error of the selected model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import MAX_RMS_RATIO, gain_p_value, is_better
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.state import State
from omnisight.display import Displayed
from omnisight.geometry.sphere import angle_from_axis
from omnisight.optim.tolerances import COMPARISON_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Rings of equal numbers of corners in which model and spline are compared.
RINGS = 6


@dataclass(frozen=True)
class SplineBaseline(Displayed):
    """The held-out errors of a spline camera and of the selected model on the same corners.

    Attributes
    ----------
    candidate
        The spline, fitted to a subset of the corners.
    observations, inliers
        This subset, and (N,) the inliers of it.
    edges
        (R + 1,) angles from the axis between the rings, radians.
    model_rms, spline_rms
        (R,) held-out rms of the selected model and of the spline in each ring, px.
    model_error
        Error of the selected model: root of the difference of the mean squares over all corners, px; 0 if the spline is
        no better.
    is_significant
        Whether the spline is better relevantly and significantly, see `is_better`.
    p_value
        Probability that chance makes the spline as much better, see `gain_p_value`.
    """

    candidate: Candidate
    observations: Observations
    inliers: NDArray[np.bool_]
    edges: Array
    model_rms: Array
    spline_rms: Array
    model_error: float
    is_significant: bool
    p_value: float

    @property
    def model_held_out_rms(self) -> float:
        """Held-out rms of the selected model on the corners of the spline, px."""
        return float(np.sqrt((self.model_rms**2).mean()))

    @property
    def worst_ring(self) -> int:
        """The ring with the largest model error."""
        return int(np.argmax(self.model_rms**2 - self.spline_rms**2))

    @property
    def is_reliable(self) -> bool:
        """Whether there were enough views to fit the spline: its held-out error is not far above that of the model."""
        return (self.candidate.held_out_rms or 0.0) <= MAX_RMS_RATIO * self.model_held_out_rms

    def __str__(self) -> str:
        """Describe the result in one sentence."""
        held_out = self.candidate.held_out_rms or 0.0
        if not self.is_reliable:
            return (
                f"not enough images to fit the spline baseline (held-out error {held_out:.3f} px); model error unknown"
            )
        if self.model_error == 0.0:
            return f"the spline baseline is no better on held-out images ({held_out:.3f} px)"
        low, high = np.degrees(self.edges[self.worst_ring : self.worst_ring + 2])
        rings = f"{self.model_rms[self.worst_ring]:.3f} against {self.spline_rms[self.worst_ring]:.3f} px"
        return (
            f"model error {self.model_error:.3f} px (held-out error of the spline baseline {held_out:.3f} px), largest"
            f" {low:.0f}° to {high:.0f}° off-axis ({rings})"
        )

    def as_dict(self) -> dict[str, object]:
        """Return the figures by name; angles in degrees."""
        return {
            "corners": self.candidate.corners,
            "rms": self.candidate.rms,
            "held_out_rms": self.candidate.held_out_rms,
            "model_error": self.model_error,
            "edges_deg": [float(edge) for edge in np.degrees(self.edges)],
            "model_rms": [float(rms) for rms in self.model_rms],
            "spline_rms": [float(rms) for rms in self.spline_rms],
        }


def fit_spline_baseline(
    best: Candidate, initial: State, observations: Observations, inliers: NDArray[np.bool_], *, loss: Loss
) -> SplineBaseline | None:
    """Fit a spline camera to a subset of the corners and compare it with the selected model on held-out views.

    Parameters
    ----------
    best
        The selected model; without cross-validation, or if it is the spline itself, the result is None.
    initial
        The initial camera; the spline starts from it if it fits the corners better.
    observations
        All views.
    inliers
        (N,) the inliers.
    loss
        As in `refine`.
    """
    if best.held_out_lengths is None or inliers.sum() < RINGS or best.name == "spline":
        return None
    nearest = min(best.state, initial, key=lambda state: float(np.median(state.lengths(observations))))
    start = replace(best, state=nearest).subsampled(observations, inliers)[0].state
    best, observations, inliers = best.subsampled(observations, inliers)
    if best.corners > len(observations.pixels):  # compare models that were trained on the same corners
        best = best.cross_validated(observations, inliers, loss=loss)
    ((_, start),) = model_starts("spline", start, observations)
    free_parameters = replace(best.free_parameters, directions=FreeParameters.of(start.model).directions)
    spline = Candidate.fit(
        "spline", start, observations, free_parameters, loss=loss, tolerance=COMPARISON_TOLERANCE
    ).cross_validated(observations, inliers, loss=loss)
    assert best.held_out_lengths is not None
    assert spline.held_out_lengths is not None
    angles = angle_from_axis(best.state.points(observations)[0][inliers])
    edges = np.quantile(angles, np.linspace(0, 1, RINGS + 1))
    ring = np.clip(np.searchsorted(edges, angles) - 1, 0, RINGS - 1)
    squares = [lengths[inliers] ** 2 for lengths in (best.held_out_lengths, spline.held_out_lengths)]
    count = np.maximum(np.bincount(ring, minlength=RINGS), 1)
    model_rms, spline_rms = (np.sqrt(np.bincount(ring, values, RINGS) / count) for values in squares)
    model_error = float(np.sqrt(max(squares[0].mean() - squares[1].mean(), 0.0)))
    is_significant = is_better(spline, best, observations, inliers)
    p_value = gain_p_value(spline, best, observations, inliers)
    return SplineBaseline(
        spline, observations, inliers, edges, model_rms, spline_rms, model_error, is_significant, p_value
    )
