"""Check that the camera is central, or nearly."""

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
    if not evidence.is_noncentral or evidence.median_residual > MAX_MEDIAN_PX * evidence.px_scale:
        return Check("central camera")
    near, far = float(test.central_error.rms_pixels[0]), float(test.central_error.rms_pixels[-1])
    level = evidence.grade(far, MAX_CENTRAL_ERROR_PX)
    sentence = (
        f"Non-central camera: a central model is {far:.2f} px off at {test.distance(2)}, {near:.2f} px at"
        f" {test.distance(0)}. Use --model axial (tried: held-out error {test.central_rms:.2f} ->"
        f" {test.axial_rms:.2f} px)."
    )
    return Check("central camera", level, sentence if level else "")
