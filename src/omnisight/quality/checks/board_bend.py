"""Check that the board does not bend differently in each image."""

from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 2

# Residuals (px) that bends explain in a good camera: poses and parameters absorb several times as much.
MAX_BEND_PX = 0.3


def check(evidence: Evidence) -> Check | None:
    """Check for a sheet without a backing."""
    test = evidence.board_bend
    if test is None:
        return None
    matters = evidence.is_board_bending and test.rms > MAX_BEND_PX * evidence.px_scale
    sentence = test.sentence if evidence.is_board_bending else ""
    return Check("board bend", Level.USABLE if matters else Level.GOOD, sentence)
