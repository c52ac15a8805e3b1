"""The result of a calibration."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.model_selection import Selection
from omnisight.calibration.noncentral import NonCentralSelection
from omnisight.calibration.ocamcalib import OcamCalibResult
from omnisight.calibration.pose_covariance import pose_covariances
from omnisight.calibration.redetection import RedetectionStats
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.quality.report import QualityReport
from omnisight.quality.verdict import Verdict
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration(Displayed):
    """A calibrated camera, and what it is based on.

    Attributes
    ----------
    camera
        The camera with its covariance, figures and provenance; a `RayCamera` if a non-central model was requested.
    observations
        The observations after re-detection.
    selection
        The candidate models and why one was selected.
    outliers
        (N,) corners whose residual exceeds five robust standard deviations.
    quality
        Uncertainty, coverage, tests and verdict.
    redetection
        What the re-detection pass added and removed.
    ocamcalib
        The result of Scaramuzza's original method, if it was requested; its model is that of `camera` then.
    seconds
        Time spent on detection and on calibration, and in total.
    """

    camera: Camera | RayCamera
    observations: Observations
    selection: Selection
    outliers: NDArray[np.bool_]
    quality: QualityReport
    redetection: RedetectionStats = field(default_factory=RedetectionStats)
    ocamcalib: OcamCalibResult | None = None
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    def __repr__(self) -> str:
        """Summarize the calibration in one line."""
        held_out = "" if self.held_out_rms is None else f", held-out error {self.held_out_rms:.3f} px"
        views = len(self.observations)
        return f"Calibration({self.best.name}, {views} views, rms {self.rms:.3f} px{held_out}, {self.verdict})"

    @property
    def verdict(self) -> Verdict:
        """Whether the calibration can be used: "good", "usable" or "do not use"."""
        return self.quality.verdict

    @property
    def reasons(self) -> tuple[str, ...]:
        """One sentence per failed check, with what to do; the worst first."""
        return self.verdict.reasons

    @property
    def best(self) -> Candidate:
        """The selected model, fitted to all observations."""
        return self.selection.best

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """All candidate models: the selected one, then the others by held-out error."""
        return self.selection.candidates

    @property
    def central(self) -> Candidate | None:
        """The central model that a non-central calibration is compared with; None for a central calibration."""
        return self.selection.central if isinstance(self.selection, NonCentralSelection) else None

    @property
    def state(self) -> State:
        """Camera model, cam_from_board of every view, and board warp."""
        return self.best.state

    @property
    def rms(self) -> float:
        """Root mean square residual length over all corners, px."""
        return self.best.rms

    @property
    def mean(self) -> float:
        """Mean residual length over all corners, px."""
        return self.best.mean

    @property
    def held_out_rms(self) -> float | None:
        """Root mean square residual length in held-out views, px; None with too few views."""
        return self.best.held_out_rms

    @property
    def residual_lengths(self) -> Array:
        """(N,) residual length of each corner, px."""
        return self.state.lengths(self.observations)

    @cached_property
    def pose_covariances(self) -> Array | None:
        """(V, 6, 6) covariance of `state.cam_from_board`, see `pose_covariance`; None if that of the camera is unknown.

        Steps (w, v) of `Pose.moved`: rotation vector in radians and translation in the unit of the board.
        """
        covariance = self.camera.covariance
        return None if covariance is None else pose_covariances(self.best, self.observations, covariance)

    def figures(self) -> dict[str, Any]:
        """Return what a camera file stores of the calibration."""
        figures: dict[str, Any] = {
            "rms": self.rms,
            "mean": self.mean,
            "held_out_rms": self.held_out_rms,
            "images": len(self.observations),
            "corners": len(self.observations.pixels),
            "outliers": int(self.outliers.sum()),
            **self.quality.figures(),
        }
        if self.best.free_parameters.warp:
            figures["board_warp"] = [float(value) for value in self.state.warp]
        if self.central is not None:
            figures |= {"central": self.central.name, "central_held_out_rms": self.central.held_out_rms}
            if self.quality.noncentrality is not None:
                figures["pupil_shift"] = self.quality.noncentrality.shift
        return figures
