"""Check of the exposure."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording, frame_list

PRIORITY = 50

# Shares of the pixels without information above which much of the view is lost.
MAX_SATURATED, MAX_BLACK = 0.15, 0.3
# Median gray levels of images in which noise hides texture.
MIN_LEVEL = 20.0
# Median gray level, and share of black pixels, of a covered lens.
COVERED_LEVEL, COVERED_BLACK = 12.0, 0.9
# Ratio of the levels of consecutive images: a change of the exposure by a third of a stop.
STEP_RATIO = 1.26


def check(recording: Recording) -> Finding:
    """Check for saturated and black pixels, and for steps of the exposure."""
    if not recording.frames:
        return Finding("exposure", Level.UNKNOWN, "no image can be read")
    saturated, black, level = (
        np.array([getattr(frame, name) for frame in recording.frames]) for name in ("saturated", "black", "level")
    )
    ratios = np.maximum(level[1:], 1) / np.maximum(level[:-1], 1)
    consecutive = np.diff([frame.index for frame in recording.frames]) == 1
    steps = int((consecutive & (np.maximum(ratios, 1 / ratios) > STEP_RATIO)).sum())
    figure = (
        f"median gray {np.median(level):.0f}, {np.median(saturated):.0%} saturated, {np.median(black):.0%} black;"
        f" {steps} steps of a third of a stop or more"
    )
    dark = [f.index for f in recording.frames if f.black > COVERED_BLACK or f.level < COVERED_LEVEL]
    if np.median(level) < MIN_LEVEL or np.median(black) > MAX_BLACK:
        return Finding(
            "exposure", Level.WARNING, figure, "too dark: more light, or a longer exposure if it is not blurred"
        )
    if np.median(saturated) > MAX_SATURATED:
        return Finding("exposure", Level.WARNING, figure, "too bright: a shorter exposure")
    if dark:
        advice = f"covered or dark: {frame_list(dark)}; poses are lost there"
        return Finding("exposure", Level.WARNING, figure, advice)
    if steps:
        return Finding("exposure", Level.OK, figure, "patches tolerate steps; a fixed exposure is better")
    return Finding("exposure", Level.OK, figure)
