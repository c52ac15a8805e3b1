"""Check the projection uncertainty over the calibrated field of view."""

import numpy as np

from omnisight.display import rounded
from omnisight.quality.coverage import side_name
from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 7

# Error (px, rms over the calibrated cone) of a good and of a usable camera, and how often its standard deviation an
# error is in one of 20 cases: the limits of the projection uncertainty are half as large as those of the error.
MAX_ERROR_PX, ERROR_SIGMA = (1.0, 2.0), 2.0
MAX_UNCERTAINTY_PX = (MAX_ERROR_PX[0] / ERROR_SIGMA, MAX_ERROR_PX[1] / ERROR_SIGMA)
# Projection uncertainty (px) of a good camera in the worst direction: four times the limit of the rms.
MAX_WORST_PX = 2.0


def check(evidence: Evidence) -> Check:
    """Check the projection uncertainty over the calibrated field of view."""
    level = uncertainty_level(evidence)
    pixels, angle, theta, phi = evidence.uncertainty.worst()
    if not np.isfinite(pixels):
        return Check("uncertainty", level, "The projection uncertainty cannot be determined: take 10 to 20 images.")
    if not level:
        return Check("uncertainty")
    return Check(
        "uncertainty",
        level,
        f"The projection uncertainty is {rounded(evidence.uncertainty.rms())} px (1σ), at most {rounded(pixels)} px"
        f" ({rounded(np.degrees(angle))}°) {np.degrees(theta):.0f}° off-axis {side_name(theta, phi)}: put the board"
        " there, tilted by 30° to 45°.",
    )


def uncertainty_level(evidence: Evidence) -> Level:
    """Return the level of the projection uncertainty."""
    worst = evidence.uncertainty.worst()[0]
    if not np.isfinite(worst):
        return Level.DO_NOT_USE
    level = evidence.grade(evidence.uncertainty.rms(), MAX_UNCERTAINTY_PX)
    return max(level, Level.USABLE if worst > MAX_WORST_PX * evidence.px_scale else Level.GOOD)
