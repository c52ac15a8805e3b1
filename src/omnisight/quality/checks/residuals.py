"""Check that the model fits most corners."""

from omnisight.quality.evidence import Check, Evidence, Level

PRIORITY = 2

# Median residual (px) above which the corners are not those of one board and one camera.
MAX_MEDIAN_PX = 2.0


def check(evidence: Evidence) -> Check:
    """Check that the model fits most corners."""
    median = evidence.median_residual
    if median <= MAX_MEDIAN_PX * evidence.px_scale:
        return Check("residuals")
    fits = "no model fits" if evidence.is_auto else f"{evidence.camera.model.name} does not fit"
    cause = f"{fits}; check that they are corners of one flat board, in order, all from one camera."
    if evidence.advice:
        cause = f"{evidence.camera.model.name} does not describe this camera: {evidence.advice}."
    return Check("residuals", Level.DO_NOT_USE, f"Half of the residuals exceed {median:.1f} px: {cause}")
