"""Images that a calibration explains worse than the others, and why that may be."""

from collections.abc import Sequence

import numpy as np

from omnisight.cli._detect_report import light
from omnisight.targets import Detections, ImageDetection

# Times the median of all images from which an rms stands out, and the least (px) that matters.
WORSE, MATTERS = 2.5, 0.15
# Times the median blur, and part of the median sharpness, past which an image is less sharp than the others.
BLURRIER, LESS_SHARP = 1.5, 0.5


def standouts(search: Detections, names: Sequence[str], rms: Sequence[float | None]) -> str | None:
    """Name the images whose rms (px, one per image) stands out, and what is odd about them; None if none does."""
    known = [error for error in rms if error is not None]
    if not known:
        return None
    usual = float(np.median(known))
    said: list[str] = []
    dropped: list[str] = []
    for picture, name, error in zip(search.images, names, rms, strict=True):
        if error is not None and error > max(WORSE * usual, MATTERS):
            reasons = _reasons(picture, search.found)
            said.append(f"{name} (rms {error:.2f} px{''.join(f', {reason}' for reason in reasons)})")
            dropped.append(f"--drop {name}")
    if not said:
        return None
    return (
        f"images that stand out from the others' median rms of {usual:.2f} px: {', '.join(said)};"
        f" look at them with --draw; to leave them out: {' '.join(dropped)}"
    )


def _reasons(picture: ImageDetection, others: Sequence[ImageDetection]) -> list[str]:
    """Say in what an image differs from the others."""
    blur = np.array([other.blur for other in others])
    sharpness = float(np.median([other.sharpness for other in others]))
    usual = float(np.median(blur[np.isfinite(blur)])) if np.isfinite(blur).any() else np.nan
    if picture.blur > BLURRIER * usual:
        return [
            f"blurred: {picture.blur:.1f} px across its edges where others have {usual:.1f} px",
            *light(picture)[1:],
        ]
    if not np.isfinite(picture.blur) and picture.sharpness < LESS_SHARP * sharpness:
        return [f"less sharp: {picture.sharpness:.2f} where others have {sharpness:.2f}", *light(picture)]
    return light(picture)
