"""Views that repeat another view: the same board pose up to noise, or nearly the same."""

from collections.abc import Sequence

import numpy as np

from omnisight.calibration.state import State
from omnisight.quality.wording import list_first
from omnisight.targets.observations import Observations

# Median distance (px) of corresponding corners below which two views are the same up to noise: with a static camera it
# is 1.7 times the standard deviation of a corner.
MAX_REPEATED_PX = 0.5
# Views nearly repeat another one if their boards are tilted against each other by less than this angle (degrees) and
# their centres are closer than this share of the image diagonal: the model, the board and the detector then err alike.
MIN_TILT_DEG, MIN_DISPLACEMENT = 10.0, 0.03


def find_repeated_views(observations: Observations) -> list[tuple[str, str]]:
    """Return the names of repeated views as pairs (first view, its repetition)."""
    pairs: list[tuple[str, str]] = []
    for i, rows in enumerate(observations.groups):
        for j in range(i):
            a, b = observations.pixels[rows], observations.pixels[observations.groups[j]]
            if a.shape == b.shape and np.median(np.linalg.norm(a - b, axis=1)) < MAX_REPEATED_PX:
                pairs.append((observations.names[j], observations.names[i]))
                break
    return pairs


def count_independent_views(state: State, observations: Observations) -> int:
    """Return the number of views of which none nearly repeats another one."""
    centres = np.array([observations.points[rows].mean(0) for rows in observations.groups])
    centres = np.einsum("kij,kj->ki", state.rotations, centres) + state.translations
    pixels, _ = state.model.project_numpy(centres)
    tilt = np.degrees(np.arccos(np.clip(np.abs(state.rotations[:, :, 2] @ state.rotations[:, :, 2].T), 0, 1)))
    displacement = np.linalg.norm(pixels[:, None] - pixels, axis=-1) / np.hypot(*observations.size)
    is_near = (tilt < MIN_TILT_DEG) & (displacement < MIN_DISPLACEMENT)
    independent: list[int] = []
    for k in range(len(observations)):
        if not is_near[k, independent].any():
            independent.append(k)
    return len(independent)


def list_pairs(pairs: Sequence[tuple[str, str]]) -> str:
    """Format the first pairs for a message."""
    return list_first([f"{a} = {b}" for a, b in pairs])
