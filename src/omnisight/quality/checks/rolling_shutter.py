"""Check that nothing moved while a rolling shutter read the rows of an image."""

from omnisight.quality.checks.uncertainty import uncertainty_level
from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.rolling_shutter import run_rolling_shutter_test

PRIORITY = 11


def check(evidence: Evidence) -> Check:
    """Check for motion during the exposure; it matters if the uncertainty, which includes its effect, is large."""
    if evidence.is_model_too_simple or evidence.is_camera_changed or evidence.is_board_bending:
        return Check("rolling shutter")
    test = run_rolling_shutter_test(evidence.candidate.state, evidence.observations)
    sentence = "" if test is None else test.sentence
    matters = bool(sentence) and uncertainty_level(evidence) > Level.GOOD
    return Check("rolling shutter", Level.USABLE if matters else Level.GOOD, sentence)
