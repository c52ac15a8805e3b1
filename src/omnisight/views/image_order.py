"""The order of the images of a rig, checked by what neighbouring cameras see of the same surface."""

from collections.abc import Sequence
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.images.gray import to_gray8
from omnisight.views.surround_remapper import SurroundRemapper

# Mean correlation of neighbouring images above which another order is likely. On planes and bowls around a real and two
# rendered cars on flat ground, images in the right order have 0.65 to 0.98, the best of all wrong orders at most 0.43.
# In a rendered town, where cars and walls hide the ground, the right order has down to -0.05, the best wrong one at
# most 0.30.
MIN_CORRELATION = 0.5
# Largest number of images whose orders are all compared: 720 orders.
MAX_IMAGES = 6


def likely_order(remapper: SurroundRemapper, images: Sequence[NDArray[Any]]) -> tuple[int, ...] | None:
    """Return for each camera the image that is likely its own; None if the given order is not refuted.

    Parameters
    ----------
    remapper
        The maps of the rig.
    images
        Simultaneous images in the order of the cameras. Images of different sizes cannot have been exchanged.
    """
    overlaps, count = remapper.overlaps, len(images)
    if not overlaps or count > MAX_IMAGES or len({image.shape[:2] for image in images}) > 1:
        return None
    grays = [to_gray8(image).astype(float) for image in images]
    correlation = np.zeros((len(overlaps), count, count))
    for k, (_, _, at_a, at_b) in enumerate(overlaps):
        seen_a, seen_b = (_standardized([gray[at[:, 1], at[:, 0]] for gray in grays]) for at in (at_a, at_b))
        correlation[k] = seen_a @ seen_b.T / len(at_a)
    orders = list(permutations(range(count)))
    means = [
        np.mean([correlation[k, order[a], order[b]] for k, (a, b, _, _) in enumerate(overlaps)]) for order in orders
    ]
    best = int(np.argmax(means))
    return orders[best] if best > 0 and means[best] > MIN_CORRELATION else None


def _standardized(rows: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return rows (I, N) of mean 0 and variance 1; zero where all levels are equal."""
    levels = np.array(rows)
    levels -= levels.mean(axis=1, keepdims=True)
    sigma = levels.std(axis=1, keepdims=True)
    return levels / np.where(sigma > 0, sigma, 1.0)
