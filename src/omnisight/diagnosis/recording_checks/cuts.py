"""Check of cuts: consecutive images that have nothing in common."""

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording, frame_list

PRIORITY = 30

# Patches that an image with texture has, and the share of them that the next image of another place shows.
MIN_TRACKED, MAX_KEPT = 40, 0.15


def check(recording: Recording) -> Finding:
    """Check for images that have nothing in common with the one before."""
    steps = [step for step in recording.steps if step.tracked >= MIN_TRACKED]
    if not steps:
        return Finding("cuts", Level.UNKNOWN, "no consecutive images with enough texture and a calibrated camera")
    cuts = [step.last for step in steps if step.kept < MAX_KEPT]
    if not cuts:
        return Finding("cuts", Level.OK, f"none between {len(steps)} pairs of consecutive images")
    return Finding(
        "cuts",
        Level.WARNING,
        f"{len(cuts)} of {len(steps)} images have nothing in common with the one before ({frame_list(cuts)})",
        "split the recording there, or remove covered images: positions on both sides have different scales",
    )
