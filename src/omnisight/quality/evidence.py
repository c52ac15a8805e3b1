"""What the checks examine, and what they report."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.board_bend import BoardBendTest
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.model_selection import CLAIM_SIGNIFICANCE
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.quality.camera_change import MAX_CHANGE_ERROR_PX, CameraChange
from omnisight.quality.coverage import Coverage
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.quality.split_half import SplitHalfTest
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.targets.observations import Observations


class Level(IntEnum):
    """How far a calibration can be used."""

    GOOD = 0
    USABLE = 1
    DO_NOT_USE = 2

    def __str__(self) -> str:
        return ("good", "usable", "do not use")[self]


@dataclass(frozen=True)
class Check(Displayed):
    """The result of one check.

    Attributes
    ----------
    name
        What was checked.
    level
        How far the calibration can be used according to this check.
    sentence
        What was found and what to do; empty if nothing is wrong.
    """

    name: str
    level: Level = Level.GOOD
    sentence: str = ""


@dataclass(frozen=True)
class Evidence:
    """Everything that a check may examine.

    Attributes
    ----------
    camera
        The calibrated camera with its covariance; the central limit of a non-central camera.
    candidate
        The selected model.
    observations, outliers
        All views, and (N,) the corners that the model does not fit.
    uncertainty, coverage
        Projection uncertainty and coverage of the field of view.
    split_half, spline_baseline, noncentrality
        Results of the tests; None if there are too few views.
    camera_change
        Two cameras that explain the images better than one, if so.
    board_bend
        How much different bends of the board explain; None if there are too few corners.
    is_auto
        Whether the model was selected automatically.
    """

    camera: Camera
    candidate: Candidate
    observations: Observations
    outliers: NDArray[np.bool_]
    uncertainty: UncertaintyMap
    coverage: Coverage
    split_half: SplitHalfTest | None
    spline_baseline: SplineBaseline | None
    noncentrality: NonCentralityTest | None
    camera_change: CameraChange | None
    board_bend: BoardBendTest | None
    is_auto: bool

    @property
    def px_scale(self) -> float:
        """Factor that converts limits for images 1000 px wide to the size of these images."""
        return self.camera.px_unit

    @cached_property
    def median_residual(self) -> float:
        """Median residual length, px."""
        return float(np.median(self.candidate.state.lengths(self.observations)))

    @property
    def is_camera_changed(self) -> bool:
        """Whether two cameras explain the images better than one, and differ relevantly or by file names."""
        change = self.camera_change
        if change is None or change.patterns:
            return change is not None
        return self.grade(change.error, MAX_CHANGE_ERROR_PX) > Level.GOOD

    @property
    def is_board_bending(self) -> bool:
        """Whether the board bends differently in each image, given one camera and a model that fits it."""
        is_explained = self.is_camera_changed or self.is_noncentral or self.is_model_too_simple
        return not is_explained and self.board_bend is not None and self.board_bend.is_positive

    @property
    def is_noncentral(self) -> bool:
        """Whether the non-central test was positive; it assumes that all images are of one camera."""
        return not self.is_camera_changed and self.noncentrality is not None and self.noncentrality.is_noncentral

    @property
    def is_model_too_simple(self) -> bool:
        """Whether the spline baseline is significantly better than the selected model, given one camera."""
        return not self.is_camera_changed and self.spline_baseline is not None and self.spline_baseline.is_significant

    @property
    def advice(self) -> str:
        """The better model that was tried, with its gain, as an instruction; empty if there is none."""
        if self.is_noncentral:
            return self._axial_advice
        baseline = self.spline_baseline
        if baseline is None or not self.is_model_too_simple or baseline.p_value >= CLAIM_SIGNIFICANCE:
            return ""
        spline_rms = baseline.candidate.held_out_rms or 0.0
        return f"use --model spline (tried: held-out error {baseline.model_held_out_rms:.2f} -> {spline_rms:.2f} px)"

    @property
    def _axial_advice(self) -> str:
        """The advice to use an axial camera; empty if halves of the images do not agree better on it."""
        test, central = self.noncentrality, self.split_half
        assert test is not None
        gain = f"held-out error {test.central_rms:.2f} -> {test.axial_rms:.2f} px"
        if central is not None and (axial := test.axial_split_half) is not None:
            if axial.difference >= central.difference:
                return ""
            gain += f", split-half difference {central.difference:.2f} -> {axial.difference:.2f} px"
        return f"use --model axial (tried: {gain})"

    def grade(self, value_px: float, limits: tuple[float, float]) -> Level:
        """Return the level of an error (px), given the largest good and the largest usable one at 1000 px width."""
        return Level(sum(int(value_px > limit * self.px_scale) for limit in limits))
