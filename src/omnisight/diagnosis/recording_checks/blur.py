"""Check of the sharpness."""

import numpy as np

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording, frame_list

PRIORITY = 60

# Standard deviation (px) of the blur of edges in images of a lens that is not in focus.
MAX_BLUR_PX = 2.0
# Blur (px), besides that of the lens, of images in motion, and the share of them that matters.
MAX_MOTION_BLUR_PX, MAX_SHARE = 1.0, 0.1


def check(recording: Recording) -> Finding:
    """Check the blur of edges: of the lens, the least in all images, and of the motion, in some."""
    known = [frame for frame in recording.frames if np.isfinite(frame.blur_px)]
    if not known:
        return Finding("blur", Level.UNKNOWN, "no image has enough edges", "light the scene and check the focus")
    blur = np.array([frame.blur_px for frame in known])
    lens = float(np.quantile(blur, 0.1))
    moving = [f.index for f in known if f.blur_px**2 > lens**2 + MAX_MOTION_BLUR_PX**2]
    figure = f"blur of edges {_length(float(np.median(blur)))} (1σ, median), {_length(lens)} in the sharpest images"
    if lens > MAX_BLUR_PX:
        return Finding("blur", Level.WARNING, figure, "focus the lens, clean it, or reduce the images")
    if len(moving) > MAX_SHARE * len(known):
        figure += f"; {len(moving)} of {len(known)} images are blurred by motion ({frame_list(moving)})"
        return Finding("blur", Level.WARNING, figure, "a shorter exposure, or slower motion")
    return Finding("blur", Level.OK, figure)


def _length(blur_px: float) -> str:
    return f"{blur_px:.1f} px" if blur_px >= 0.05 else "less than 0.1 px"
