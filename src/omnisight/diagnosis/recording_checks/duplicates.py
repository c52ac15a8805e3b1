"""Check of images that occur twice."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording, frame_list

PRIORITY = 20

# Mean absolute difference (gray levels) to the image before: half that of two images of a sensor with little noise.
MAX_DIFFERENCE = 0.3
# Share of the images above which the rate is not that of the camera.
MAX_SHARE = 0.02


def check(recording: Recording) -> Finding:
    """Check for images that are equal to the one before."""
    examined = [frame for frame in recording.frames if np.isfinite(frame.difference)]
    if not examined:
        return Finding("duplicates", Level.UNKNOWN, "no consecutive images")
    equal = [frame.index for frame in examined if frame.difference < MAX_DIFFERENCE]
    if len(equal) <= MAX_SHARE * len(examined):
        return Finding("duplicates", Level.OK, f"{len(equal)} of {len(examined)} images equal the one before")
    figure = f"{len(equal)} of {len(examined)} images equal the one before ({frame_list(equal)})"
    advice = "export the clip at the rate of the camera: times of repeated images are wrong"
    if len(equal) == len(examined):
        advice = "the images show no motion: record a moving camera"
    return Finding("duplicates", Level.WARNING, figure, advice)
