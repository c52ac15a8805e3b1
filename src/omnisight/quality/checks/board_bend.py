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
    if not evidence.is_board_bending:
        return Check("board bend")
    if evidence.candidate.state.bends is not None:
        action = "The bends are estimated; a rigid plate would make the camera more certain."
        return Check("board bend", sentence=f"{test.finding} {action}")
    matters = test.rms > MAX_BEND_PX * evidence.px_scale
    action = "Glue it to a rigid plate and take the images again."
    return Check("board bend", Level.USABLE if matters else Level.GOOD, f"{test.finding} {action}")
