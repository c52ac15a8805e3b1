"""Check of the times of the images."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 10

# Interval over the median one above which images are missing between two.
MAX_INTERVAL_RATIO = 1.6
# Turn (degrees) from one image to the next above which motion prediction often fails.
MAX_TURN_DEG = 15.0


def check(recording: Recording) -> Finding:
    """Check the rate of the images, gaps between them, and how far the camera turns from one to the next."""
    intervals = np.diff(recording.times)
    if not len(intervals):
        return Finding("frame rate", Level.FAILED, "one image", "specify a clip, or a folder of two or more images")
    median = float(np.median(intervals))
    gaps = int((intervals > MAX_INTERVAL_RATIO * median).sum())
    figure = f"{1 / median:.3g} images per second, {recording.times_from}"
    if gaps:
        figure += f"; {gaps} gaps, the longest of {intervals.max():.2g} s"
    turns = np.degrees([np.linalg.norm(step.turn) for step in recording.steps])
    turns = turns[np.isfinite(turns)]
    if len(turns):
        figure += f"; turns by up to {turns.max():.1f}° from one image to the next"
    if len(turns) and turns.max() > MAX_TURN_DEG:
        return Finding("frame rate", Level.WARNING, figure, "record more images per second, or turn more slowly")
    if gaps:
        return Finding("frame rate", Level.WARNING, figure, "images are missing: record to a faster disk or card")
    return Finding("frame rate", Level.OK, figure)
