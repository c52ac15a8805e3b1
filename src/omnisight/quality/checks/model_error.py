"""Check that a spline camera is not significantly better than the selected model."""

from omnisight.quality.evidence import Check, Evidence

PRIORITY = 3

# Model error (px) of a good and of a usable camera: the projection error is three to five times as large or more,
# because poses and parameters absorb the rest.
MAX_MODEL_ERROR_PX = (0.1, 0.5)


def check(evidence: Evidence) -> Check | None:
    """Check the difference between the selected model and the spline baseline."""
    baseline = evidence.spline_baseline
    if baseline is None:
        return None
    level = evidence.grade(baseline.model_error, MAX_MODEL_ERROR_PX)
    if not level or not evidence.is_model_too_simple or evidence.is_noncentral:
        return Check("model error")
    return Check(
        "model error",
        level,
        f"The model error of {evidence.camera.model.name} is {baseline.model_error:.2f} px (difference from a spline"
        f" fit), which the stated uncertainty does not include: {evidence.advice or 'add images'}.",
    )
