"""HTML of the comparison of two cameras: the maps of their difference and of their uncertainties."""

import numpy as np

from omnisight.quality.camera_comparison import CameraComparison
from omnisight.report.drawings.camera_comparison import draw_comparison
from omnisight.report.notebook._summary import WIDE_PX, photo_url, summary


def html(comparison: CameraComparison) -> str:
    """Return the verdict, the difference and its maps."""
    c = comparison
    sigma = c.test.expected_rms
    expected = f"{sigma:.3g} px" if np.isfinite(sigma) else "unknown: the cameras have no covariance"
    figures = {
        "cameras": ", ".join(c.names),
        "difference": f"{c.rms:.3g} px rms after the best rotation",
        "expected": expected,
        "largest": f"{c.aligned.pixels[c.worst]:.3g} px, {c.worst_place}",
        "verdict": c.verdict,
    }
    return summary("CameraComparison", figures, photo_url(draw_comparison(c), WIDE_PX), [c.sentence], width=WIDE_PX)
