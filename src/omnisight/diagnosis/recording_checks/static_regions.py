"""Check of regions that look the same in all images."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 90


def check(recording: Recording) -> Finding:
    """Check for regions that look the same in all images: the vehicle, a tripod, the photographer, dirt."""
    region = recording.static_region
    if region is None:
        return Finding("static regions", Level.UNKNOWN, "not determined: too few images, or they are too similar")
    if not region.any():
        return Finding("static regions", Level.OK, "none")
    rows, columns = np.nonzero(region)
    place = f"columns {columns.min()} to {columns.max()}, rows {rows.min()} to {rows.max()}"
    figure = f"{region.mean():.1%} of the image looks the same in all images: {place}"
    return Finding("static regions", Level.WARNING, figure, "exclude the vehicle, tripod or dirt: --mask mask.png")
