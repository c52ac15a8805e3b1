"""Check that all images are of one camera that did not change."""

from omnisight.quality.camera_change import MAX_CHANGE_ERROR_PX
from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.wording import list_first

PRIORITY = 1


def check(evidence: Evidence) -> Check:
    """Check for a second camera: a change of focus, zoom or binning, or images of two cameras."""
    change = evidence.camera_change
    if change is None or not evidence.is_camera_changed:
        return Check("camera change")
    effect = (
        f"magnification x{change.magnification:.4f}, principal point shifted by {change.shift:.1f} px, difference"
        f" {change.difference:.1f} px"
    )
    second = change.names_of(second=True)
    if change.orientation:
        sentence = (
            f"{len(second)} of {len(change.names)} images are {change.orientation} ({list_first(second)}), or the"
            " others are: with that undone, one camera fits all. Use the files as the camera wrote them."
        )
    elif change.patterns:
        quoted = [f"'{pattern}'" for pattern in change.patterns]
        sentence = (
            f"The images are of {len(quoted)} cameras, {list_first(quoted)} ({effect}): calibrate each separately,"
            f" as in omnisight calibrate {quoted[0]}."
        )
    elif change.in_order:
        sentence = (
            f"The camera changed at image {change.first_changed}, by focus, zoom, binning or crop ({effect}): calibrate"
            " the images before and from there on separately."
        )
    else:
        sentence = (
            f"The images are of two cameras, or of one that changed to and fro: {len(second)} of {len(change.names)}"
            f" differ from the others ({list_first(second)}; {effect}). Calibrate them separately."
        )
    # Images of two cameras are never a good set, however similar the cameras are.
    return Check("camera change", max(evidence.grade(change.error, MAX_CHANGE_ERROR_PX), Level.USABLE), sentence)
