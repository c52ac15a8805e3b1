"""Everything that says how far a calibration can be trusted."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.images import ImageField
from omnisight.quality.coverage import Coverage
from omnisight.quality.evidence import Evidence
from omnisight.quality.noncentral_test import NonCentralityTest, run_noncentrality_test
from omnisight.quality.spline_baseline import SplineBaseline, fit_spline_baseline
from omnisight.quality.split_half import SplitHalfTest, run_split_half_test
from omnisight.quality.uncertainty import UncertaintyMap
from omnisight.quality.verdict import Verdict
from omnisight.targets.observations import Observations


@dataclass(frozen=True)
class QualityReport:
    """How far a calibration can be trusted.

    Attributes
    ----------
    uncertainty
        How sure the camera is, at every angle and azimuth.
    coverage
        Where corners were seen.
    halves
        Whether two halves of the images agree; None with too few.
    ceiling
        What the model leaves that a spline explains; None with too few images.
    viewpoint
        Whether the viewpoint moves along the axis; None with too few images.
    verdict
        Whether to use it, and what to do where not.
    """

    uncertainty: UncertaintyMap
    coverage: Coverage
    halves: SplitHalfTest | None
    ceiling: SplineBaseline | None
    viewpoint: NonCentralityTest | None
    verdict: Verdict

    def figures(self) -> dict[str, Any]:
        """Give what a camera's file keeps of it."""
        pixels, angle, _, _ = self.uncertainty.worst()
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.verdict.reasons),
            "uncertainty_px": pixels if np.isfinite(pixels) else None,
            "uncertainty_deg": float(np.degrees(angle)) if np.isfinite(angle) else None,
            "covered": self.coverage.share,
            "halves": self.split_half and self.split_half.as_dict(),
            "spline": self.spline_baseline and self.spline_baseline.as_dict(),
        }


def assess(
    best: Candidate,
    camera: Camera,
    views: Observations,
    usable: NDArray[np.bool_],
    *,
    scout: State,
    field: ImageField | None,
    loss: str,
    auto: bool,
) -> tuple[Camera, QualityReport]:
    """Say how far the best candidate can be trusted, and give its camera with its covariance."""
    halves = run_split_half_test(best, views, lambda m, c: replace(camera, model=m, covariance=c), loss=loss)
    camera = replace(camera, covariance=camera_covariance(best, views, loss=loss))
    uncertainty = UncertaintyMap.of(camera, field=field)
    coverage = Coverage.of(camera, best.state, views, field)
    ceiling = fit_spline_baseline(best, scout, views, usable, loss=loss)
    viewpoint = run_noncentrality_test(best, camera, views, usable, ceiling)
    evidence = Evidence(camera, best, views, uncertainty, coverage, halves, ceiling, viewpoint, ~usable, auto)
    return camera, QualityReport(uncertainty, coverage, halves, ceiling, viewpoint, Verdict.of(evidence))
