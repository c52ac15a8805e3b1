"""Check that the camera is central, or nearly."""

from omnisight.calibration.model_selection import SELECTION_SIGNIFICANCE
from omnisight.quality.checks.residuals import MAX_MEDIAN_PX
from omnisight.quality.evidence import Check, Evidence

PRIORITY = 4

# Error of the central model at a great distance (px) of a good and of a usable camera.
MAX_CENTRAL_ERROR_PX = (0.5, 2.0)


def check(evidence: Evidence) -> Check | None:
    """Check the error of the central model for near and distant objects."""
    test = evidence.noncentrality
    if test is None:
        return None
    is_possible = evidence.is_noncentral or (test.is_inconclusive and test.p_value < SELECTION_SIGNIFICANCE)
    unusable = evidence.is_camera_changed or evidence.median_residual > MAX_MEDIAN_PX * evidence.px_scale
    near, far = float(test.central_error.rms_pixels[0]), float(test.central_error.rms_pixels[-1])
    level = evidence.grade(far, MAX_CENTRAL_ERROR_PX)
    if not is_possible or unusable or not level:
        return Check("central camera")
    errors = f"a central model is {far:.2f} px off at {test.distance(2)}, {near:.2f} px at {test.distance(0)}"
    if not evidence.is_noncentral:
        sentence = f"The camera may be non-central: in that case {errors}; {test.doubt}."
        return Check("central camera", level, sentence)
    action = evidence.advice or "--model axial does not help (tried: split halves agree no better)"
    return Check("central camera", level, f"Non-central camera: {errors}; {action}.")
