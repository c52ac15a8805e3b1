"""What a low rms hides: pictures that say the same, boards that never tilt."""

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.refine import State
from omnisight.calibrate.views import BoardViews

Array = NDArray[np.float64]

SAME_PX = 0.5
TILT_DEG = 10.0
FEW = 3
LARGE_PX = 2.0


def doubts(state: State, views: BoardViews, *, auto: bool) -> tuple[str, ...]:
    """Give what makes a calibration doubtful, a sentence with one action each; `auto` if several models were tried."""
    found: list[str] = []
    if len(views) < FEW:
        found.append(
            f"With fewer than {FEW} pictures parameters may be far off where the residuals are small; take 10 to 20."
        )
    if same := _same_pictures(views):
        more = ", ..." if len(same) > 3 else ""
        pairs = ", ".join(f"{a} = {b}" for a, b in same[:3])
        found.append(
            f"Pictures that repeat another one: {len(same)} ({pairs}{more}). They add nothing: move the board between"
            " pictures."
        )
    median = float(np.median(state.lengths(views)))
    if median > LARGE_PX:
        why = (
            "no model explains them; are they corners of one flat board, in order, all from one camera?"
            if auto
            else f"{state.model.name} does not describe this camera; use --model auto."
        )
        found.append(f"Half of the corners are more than {median:.1f} px off: {why}")
    tilt = _largest_tilt(state)
    if len(views) > 1 and tilt < TILT_DEG:
        found.append(
            f"The boards tilt only {tilt:.0f} degrees against each other, which leaves the focal length open:"
            " take pictures with the board tilted by 30 to 45 degrees."
        )
    return tuple(found)


def _same_pictures(views: BoardViews) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    for i, rows in enumerate(views.groups):
        for j in range(i):
            other = views.groups[j]
            a, b = views.pixels[rows], views.pixels[other]
            if a.shape == b.shape and np.abs(a - b).max() < SAME_PX:
                found.append((views.names[j], views.names[i]))
                break
    return found


def _largest_tilt(state: State) -> float:
    normals = state.rotations[:, :, 2]
    return float(np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T), 0, 1))).max())
