"""Quality report: uncertainty, coverage, tests and verdict of a calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.board_bend import BoardBendTest, run_board_bend_test
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.model_averaging import averaged_covariance
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.display import Displayed, rounded
from omnisight.models import CameraModel, Projector
from omnisight.optics.models.axial import Axial
from omnisight.quality.camera_change import CameraChange, find_camera_change
from omnisight.quality.central_frame import in_central_frame
from omnisight.quality.coverage import Coverage
from omnisight.quality.evidence import Evidence
from omnisight.quality.noncentral_test import NonCentralityTest, compare_central, run_noncentrality_test
from omnisight.quality.spline_baseline import SplineBaseline
from omnisight.quality.split_half import SplitHalfTest, run_split_half_test
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.quality.verdict import Verdict
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class QualityReport(Displayed):
    """Uncertainty, coverage, tests and verdict of a calibration.

    Attributes
    ----------
    uncertainty
        Projection uncertainty at every angle and azimuth.
    coverage
        Where in the field of view corners were observed.
    split_half
        Agreement of two halves of the views; None with too few views.
    spline_baseline
        Error of the selected model against a spline; None with too few views, and for non-central cameras.
    noncentrality
        Whether the entrance pupil shifts along the axis; None with too few views.
    camera_change
        Two cameras that explain the images better than one; None if one does.
    board_bend
        How much different bends of the board explain; None if there are too few corners.
    verdict
        Whether the calibration can be used, and what to do if not.
    """

    uncertainty: UncertaintyMap
    coverage: Coverage
    split_half: SplitHalfTest | None
    spline_baseline: SplineBaseline | None
    noncentrality: NonCentralityTest | None
    camera_change: CameraChange | None
    board_bend: BoardBendTest | None
    verdict: Verdict

    def __repr__(self) -> str:
        """Summarize the report in one line."""
        return f"QualityReport({self.verdict}, uncertainty {rounded(self.uncertainty.rms())} px)"

    def figures(self) -> dict[str, Any]:
        """Return the figures that a camera file keeps."""
        pixels, angle, _, _ = self.uncertainty.worst()
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.verdict.reasons),
            "uncertainty_px": pixels if np.isfinite(pixels) else None,
            "uncertainty_deg": float(np.degrees(angle)) if np.isfinite(angle) else None,
            "coverage": self.coverage.share,
            "split_half": self.split_half and self.split_half.as_dict(),
            "spline_baseline": self.spline_baseline and self.spline_baseline.as_dict(),
            "camera_change": self.camera_change and self.camera_change.as_dict(),
            "board_bend": self.board_bend and self.board_bend.as_dict(),
        }


def assess_central(
    best: Candidate,
    candidates: Sequence[Candidate],
    camera: Camera,
    observations: Observations,
    outliers: Bools,
    baseline: SplineBaseline | None,
    *,
    loss: Loss,
    is_auto: bool,
) -> tuple[Camera, QualityReport]:
    """Return a central camera with its covariance, and its quality report."""
    covariance = averaged_covariance(best, candidates, observations, loss=loss)
    camera = replace(camera, covariance=covariance)
    noncentrality = run_noncentrality_test(best, camera, observations, ~outliers, baseline)

    def as_camera(model: Projector, covariance: Array) -> Camera:
        assert isinstance(model, CameraModel)
        return replace(camera, model=model, covariance=covariance)

    report = _assess(
        best,
        camera,
        best.state,
        observations,
        outliers,
        as_camera,
        baseline=baseline,
        noncentrality=noncentrality,
        loss=loss,
        is_auto=is_auto,
    )
    return camera, report


def assess_noncentral(
    best: Candidate,
    central: Candidate,
    camera: RayCamera,
    observations: Observations,
    outliers: Bools,
    inliers: Bools,
    *,
    baseline: SplineBaseline | None,
    loss: Loss,
) -> tuple[RayCamera, QualityReport]:
    """Return a non-central camera with its covariance, and the quality report of its central limit.

    The spline baseline, a central camera, is only used to compare with; its model error does not apply.
    """
    camera = replace(camera, covariance=camera_covariance(best, observations, loss=loss))
    noncentrality = None
    if isinstance(camera.model, Axial) and best.held_out_lengths is not None:
        noncentrality = compare_central(central, best, camera, observations, inliers, baseline)
    state = in_central_frame(best.state, camera.model, observations.pixels[~outliers])

    def as_camera(model: Projector, covariance: Array) -> Camera:
        return replace(camera, model=model, covariance=covariance).central_limit

    limit = camera.central_limit
    report = _assess(best, limit, state, observations, outliers, as_camera, loss=loss, is_auto=True)
    return camera, replace(report, noncentrality=noncentrality)


def _assess(
    best: Candidate,
    camera: Camera,
    state: State,
    observations: Observations,
    outliers: Bools,
    as_camera: Callable[[Projector, Array], Camera],
    *,
    baseline: SplineBaseline | None = None,
    noncentrality: NonCentralityTest | None = None,
    loss: Loss,
    is_auto: bool,
) -> QualityReport:
    """Run all tests; `camera` and `state` are those of the central limit for a non-central camera."""
    uncertainty = UncertaintyMap.of(camera, field=observations.field)
    coverage = Coverage.of(camera, state, observations)
    split_half = run_split_half_test(best, observations, as_camera, loss=loss)
    camera_change = find_camera_change(best, observations, loss=loss)
    # A shift of the entrance pupil separates near boards from far ones, which resembles two cameras.
    if camera_change is not None and noncentrality is not None and noncentrality.axial.rms < camera_change.rms:
        camera_change = None
    board_bend = run_board_bend_test(replace(best.state, bends=None), observations)
    evidence = Evidence(
        camera,
        best,
        observations,
        outliers,
        uncertainty,
        coverage,
        split_half,
        baseline,
        noncentrality,
        camera_change,
        board_bend,
        is_auto,
    )
    verdict = Verdict.of(evidence)
    return QualityReport(uncertainty, coverage, split_half, baseline, noncentrality, camera_change, board_bend, verdict)
