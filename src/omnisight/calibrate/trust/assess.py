"""Everything that says how far a calibration can be trusted."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.candidates import Candidate
from omnisight.calibrate.rays.ask import Asked, ask_about
from omnisight.calibrate.state import State
from omnisight.calibrate.trust.ceiling import Ceiling, fit_ceiling
from omnisight.calibrate.trust.covariance import camera_covariance
from omnisight.calibrate.trust.coverage import Coverage
from omnisight.calibrate.trust.evidence import Evidence
from omnisight.calibrate.trust.halves import Halves, compare_halves
from omnisight.calibrate.trust.uncertainty import UncertaintyMap
from omnisight.calibrate.trust.verdict import Verdict
from omnisight.calibrate.views import BoardViews
from omnisight.camera import Camera
from omnisight.images import ImageField


@dataclass(frozen=True)
class Trust:
    """How far a calibration can be trusted.

    Attributes
    ----------
    uncertainty
        How sure the camera is, at every angle and azimuth.
    coverage
        Where corners were seen.
    halves
        Whether two halves of the pictures agree; None with too few.
    ceiling
        What the model leaves that a spline explains; None with too few pictures.
    viewpoint
        Whether the viewpoint moves along the axis; None with too few pictures.
    verdict
        Whether to use it, and what to do where not.
    """

    uncertainty: UncertaintyMap
    coverage: Coverage
    halves: Halves | None
    ceiling: Ceiling | None
    viewpoint: Asked | None
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
            "halves": self.halves and self.halves.as_dict(),
            "spline": self.ceiling and self.ceiling.as_dict(),
        }


def assess(
    best: Candidate,
    camera: Camera,
    views: BoardViews,
    usable: NDArray[np.bool_],
    *,
    scout: State,
    field: ImageField | None,
    loss: str,
    auto: bool,
) -> tuple[Camera, Trust]:
    """Say how far the best candidate can be trusted, and give its camera with its covariance."""
    halves = compare_halves(best, views, lambda m, c: replace(camera, model=m, covariance=c), loss=loss)
    camera = replace(camera, covariance=camera_covariance(best, views, loss=loss))
    uncertainty = UncertaintyMap.of(camera, field=field)
    coverage = Coverage.of(camera, best.state, views, field)
    ceiling = fit_ceiling(best, scout, views, usable, loss=loss)
    viewpoint = ask_about(best, camera, views, usable, ceiling)
    evidence = Evidence(camera, best, views, uncertainty, coverage, halves, ceiling, viewpoint, ~usable, auto)
    return camera, Trust(uncertainty, coverage, halves, ceiling, viewpoint, Verdict.of(evidence))
