"""Check the error on images that the camera was not calibrated on."""

from omnisight.calibration.model_selection import MAX_RMS_RATIO
from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 6

# Held-out error (px) of a good and of a usable camera: 0.7 px is corner noise of 0.5 px per coordinate, 2 px is an
# error that noise does not explain.
MAX_HELD_OUT_PX = (0.7, 2.0)
# Error (px) below which no ratio of errors matters.
NEGLIGIBLE_PX = 0.1


def check(evidence: Evidence) -> Check:
    """Check the held-out error and its ratio to the training error."""
    error, rms = evidence.candidate.held_out_rms, evidence.candidate.rms
    if error is None:
        return Check("held-out error", Level.USABLE, "Too few images for a held-out error: take 10 to 20.")
    level = evidence.grade(error, MAX_HELD_OUT_PX)
    if level:
        action = (
            f"{evidence.camera.model.name} does not describe this camera; {evidence.advice}."
            if evidence.advice
            else "look at the images with the largest residuals (--draw), and drop those that are blurred or whose"
            " board is not flat (--drop)."
        )
        return Check("held-out error", level, f"The held-out error is {error:.2f} px: {action}")
    if error > MAX_RMS_RATIO * rms and error > NEGLIGIBLE_PX * evidence.px_scale:
        return Check(
            "held-out error",
            Level.USABLE,
            f"The held-out error is {error / rms:.1f} times the rms ({error:.2f} and {rms:.2f} px), which indicates"
            " overfitting: add images.",
        )
    return Check("held-out error")
