"""Check that the corners cover the field of view on all sides."""

import numpy as np

from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 8

# Share of the visible field of view in which there should be corners. Cameras below were off by little all the same,
# but nothing verifies them there.
MIN_SHARE = 0.6
# Range of azimuths (radians) that may lack corners.
MAX_GAP_RAD = np.radians(150)


def check(evidence: Evidence) -> Check:
    """Check that the corners cover the field of view on all sides."""
    coverage = evidence.coverage
    if coverage.gap >= MAX_GAP_RAD:
        return Check(
            "coverage",
            Level.USABLE,
            f"No corners in a sector of {np.degrees(coverage.gap):.0f}°: put the board at {coverage.empty_side()}.",
        )
    if coverage.share < MIN_SHARE:
        return Check(
            "coverage",
            Level.USABLE,
            f"Corners cover {coverage.share:.0%} of the visible field of view: put the board {coverage.missing()}.",
        )
    return Check("coverage")
