"""Views that repeat another view: same board pose, up to noise."""

from collections.abc import Sequence

import numpy as np

from omnisight.quality.wording import list_first
from omnisight.targets.observations import Observations

# Median distance (px) of corresponding corners below which two views are the same up to noise: with a static camera it
# is 1.7 times the standard deviation of a corner.
MAX_REPEATED_PX = 0.5


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


def list_pairs(pairs: Sequence[tuple[str, str]]) -> str:
    """Format the first pairs for a message."""
    return list_first([f"{a} = {b}" for a, b in pairs])
