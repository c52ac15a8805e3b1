"""Verification of frames: by points that a third image shows too, and by matches that are not missing."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, triu
from scipy.sparse.csgraph import connected_components

from omnisight.sfm.common_points import common_points, frames_with_common_points
from omnisight.sfm.incidence import biconnected_parts
from omnisight.sfm.missing_matches import ComparedImages, Links, contradicted_links

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Points in three or more images, below which two frames do not verify each other: furniture of the same shape connects
# images of different rooms. In 16 sets of rendered rooms that look alike, 17 of 148 verified images are in wrong places
# with 8 points, 7 of 127 with 12, and 7 of 96 with 20, without the test of missing matches. In six sets with all images
# in their places, each image has 129 points or more in common with another one.
MIN_VERIFIED = 12


def verified_frames(
    image: Indices, point: Indices, frame: Indices, compared: ComparedImages, repeatability: float
) -> NDArray[np.bool_]:
    """Return which frames (F,) are in the largest part that points in three or more images connect.

    Points in two images agree with wrong relative poses too, and leave the scale between pairs of images open. Two
    frames are connected by `MIN_VERIFIED` points that both and a third image show. Parts of a model between which more
    matches are missing than agree are apart. Two parts that only one image connects are apart too: no point of one is
    in another image of the other, so that their relative scale is open.

    Parameters
    ----------
    image, point
        (M,) of the observations.
    frame
        (I,) of the images; -1 for images without a pose.
    compared
        Pairs of images that were compared: others can lack matches without a contradiction.
    repeatability
        Share of the predicted matches that images from one place have.
    """
    use = np.bincount(point)[point] >= 3
    image, point = image[use], point[use]
    images, frames, posed = len(frame), int(frame.max(initial=-1)) + 1, np.flatnonzero(frame >= 0)
    common, of_one_frame = common_points(images, image, point), common_points(images, posed, frame[posed])
    enough = frames_with_common_points(common_points(frames, frame[image], point), MIN_VERIFIED)
    upper = triu(common, 1).tocoo()
    a, b = frame[upper.row], frame[upper.col]
    use = (a != b) & enough[a, b]
    linked, number = np.column_stack([upper.row[use], upper.col[use]]).astype(np.intp), np.array(upper.data[use], float)
    is_connected = _agreeing(frame, linked, number, compared, repeatability)
    verified = np.zeros(frames, bool)
    for part in biconnected_parts(common + of_one_frame):
        inside = np.unique(frame[part])
        label = connected_components(is_connected[inside][:, inside], directed=False)[1]
        connected = inside[label == np.bincount(label).argmax()]
        if len(connected) > max(verified.sum(), 2):
            verified = np.isin(np.arange(frames), connected)
    return verified


def _agreeing(
    frame: Indices, linked: Indices, common: Array, compared: ComparedImages, repeatability: float
) -> csr_array:
    """Return which frames (F, F) pairs of images (N, 2) connect, without parts between which more matches lack.

    Parameters
    ----------
    frame
        (I,) of the images.
    linked, common
        Pairs of images (N, 2), and their numbers of common points (N,).
    compared, repeatability
        See `verified_frames`.
    """
    count, (a, b) = int(frame.max(initial=-1)) + 1, frame[linked].T
    predicted, _, matches, _ = np.array(compared.predictions, float).reshape(-1, 4).T
    _, first, second = np.intersect1d(
        *(pairs @ [len(frame), 1] for pairs in (linked, compared.pairs)), assume_unique=True, return_indices=True
    )
    number = common.copy()
    number[first] = matches[second]
    links = Links(a, b, number)
    missing = Links(a[first], b[first], (repeatability * predicted - matches)[second])
    while (wrong := contradicted_links(count, links, missing)).any():
        links = links.select(~wrong)
    return csr_array(coo_array((np.ones(len(links.a)), (links.a, links.b)), shape=(count, count)))
