"""Verification of frames: by points that a third image shows too."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Indices = NDArray[np.intp]

# Points in three or more images, below which two frames do not verify each other: in rendered rooms that look alike,
# images in wrong places had 3 to 5, and those in their places 10 or more.
MIN_VERIFIED = 8


def verified_frames(frame: Indices, point: Indices, frames: int) -> NDArray[np.bool_]:
    """Return which frames (F,) are in the largest part that points in three or more images connect.

    Points in two images agree with wrong relative poses too, and leave the scale between pairs of images open. Two
    frames are connected by `MIN_VERIFIED` points that both and a third image show.

    Parameters
    ----------
    frame, point
        (M,) of the observations.
    frames
        Number of frames F.
    """
    points = int(point.max(initial=-1)) + 1
    use = np.bincount(point, minlength=points)[point] >= 3
    seen = coo_array((np.ones(int(use.sum()), bool), (point[use], frame[use])), shape=(points, frames)).tocsr()
    seen = seen.astype(np.int64)
    seen.data[:] = 1  # several images of a frame see a point once
    label = connected_components((seen.T @ seen) >= MIN_VERIFIED, directed=False)[1]
    sizes = np.bincount(label, minlength=1)
    return (label == sizes.argmax()) & (sizes.max() > 1)
