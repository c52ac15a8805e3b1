"""Check of the texture that patches need."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 40

# Patches of an image: 24 points are needed for a pose, and half of the patches may be lost or wrong.
MIN_PATCHES, FEW_PATCHES = 50, 100


def check(recording: Recording) -> Finding:
    """Check in how many cells of equal solid angle there is a corner."""
    if recording.tracking is None or not recording.corners:
        return Finding("texture", Level.UNKNOWN, "not measured without a calibrated camera")
    median, least = int(np.median(recording.corners)), min(recording.corners)
    figure = f"corners in {median} of {recording.tracking.cells} cells of the view (median), at least {least}"
    if median < MIN_PATCHES:
        return Finding("texture", Level.FAILED, figure, "light the scene, clean the lens, or focus: too few corners")
    if least < FEW_PATCHES:
        return Finding("texture", Level.WARNING, figure, "some images show too little: avoid walls and the dark")
    return Finding("texture", Level.OK, figure)
