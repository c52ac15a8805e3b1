"""Tolerances of a mirror camera, from its sensitivity to misalignment and slope errors."""

from dataclasses import dataclass

import numpy as np

from omnisight.optics.design.mirror_design import MirrorDesign
from omnisight.optics.design.performance import MISALIGNMENTS, Performance

# Largest image error that one tolerance may cause, px: about the error of a detected corner.
MAX_ERROR_PX = 0.25
# The misalignments that tolerances are scaled from: small enough for the effects to be linear.
SMALL_MISALIGNMENTS = ("0.1 mm axial", "0.1 mm lateral", "tilt 0.1°")


@dataclass(frozen=True)
class Tolerances:
    """Limits within which a mirror camera is central to `MAX_ERROR_PX` and its image stays on the sensor.

    Attributes
    ----------
    axial, lateral
        Displacement of the mirror along and across the axis, metres; NaN if the mirror is too small to be displaced by
        0.1 mm.
    tilt
        Tilt of the mirror about its vertex, radians.
    slope
        Slope error of the surface, radians: it turns a ray by twice as much.
    """

    axial: float
    lateral: float
    tilt: float
    slope: float


def compute_tolerances(design: MirrorDesign, performance: Performance) -> Tolerances:
    """Compute the tolerances of a design.

    Misalignment is limited by the parallax at the working distance, which calibration cannot remove, beyond that of the
    design itself, and by the image shift, which must not move the mirror's image off the sensor.
    """
    rows = {row.description: row for row in performance.misalignments}
    designed = rows["as designed"].worst_px
    margin_px = min(design.specification.size) / 2 - design.circle

    def limit(description: str) -> float:
        """Return the largest misalignment of a kind, by its smallest row."""
        if (row := rows.get(description)) is None:
            return np.nan
        (amount,) = MISALIGNMENTS[description].values()
        with np.errstate(divide="ignore"):
            by_parallax = np.divide(MAX_ERROR_PX, abs(row.worst_px - designed))
            by_shift = np.divide(margin_px, row.moved_px)
        return float(amount * min(by_parallax, by_shift))

    finest = max(float(performance.resolution.up.max()), float(performance.resolution.around.max()))
    axial, lateral, tilt = (limit(description) for description in SMALL_MISALIGNMENTS)
    return Tolerances(axial, lateral, tilt, slope=MAX_ERROR_PX / (2 * finest))
