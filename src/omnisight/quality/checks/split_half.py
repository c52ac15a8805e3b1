"""Check that two halves of the images give the same camera within its uncertainty."""

from omnisight.quality.checks.held_out_error import NEGLIGIBLE_PX
from omnisight.quality.checks.uncertainty import MAX_UNCERTAINTY_PX
from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 10

# Difference of the halves relative to the one that noise explains.
MAX_RATIO = 3.0
# Difference (px) of a good camera: both halves have half of the images, so both are off by more than the camera of all.
MAX_DIFFERENCE_PX = 2 * MAX_UNCERTAINTY_PX[0]


def check(evidence: Evidence) -> Check | None:
    """Check the difference between the two halves against its prediction."""
    test = evidence.split_half
    if test is None:
        return None
    if test.ratio <= MAX_RATIO or test.difference <= NEGLIGIBLE_PX * evidence.px_scale:
        return Check("split-half test")
    if evidence.is_camera_changed:
        cause = "the images are of two cameras, or the camera changed."
    elif evidence.is_noncentral:
        cause = "the camera is non-central."
    elif evidence.is_model_too_simple:
        cause = f"the model does not fit this lens: {evidence.advice or 'add images'}."
    elif evidence.is_board_bending:
        cause = "the board bends differently in each image; the stated uncertainty includes it."
    else:
        cause = (
            "a board that is not flat or not to scale, a lens that refocused, or blur; the stated uncertainty includes"
            " it. Find those images with --draw and leave them out (--drop)."
        )
    return Check(
        "split-half test",
        Level.USABLE if test.difference > MAX_DIFFERENCE_PX * evidence.px_scale else Level.GOOD,
        f"The cameras of two halves of the images differ by {test.difference:.2f} px, {test.ratio:.1f} times as much as"
        f" corner noise explains: {cause}",
    )
