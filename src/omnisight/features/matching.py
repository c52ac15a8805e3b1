"""Matching of keypoints by their descriptors, and along epipolar curves."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.features.keypoints import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import hat

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
# Returns which pairs (rows of a, all of b) may match.
Admissible = Callable[[slice], NDArray[np.bool_]]

# Squared distances of SIFT descriptors below this are equal: float32 has no smaller differences from similarity 1.
MIN_SQUARED_DISTANCE = 4e-6
# Rows of the similarity matrix that are computed at a time: for 4000 keypoints they fit in the cache of a core, and
# matching takes a fifth less than with 1024 rows.
BLOCK_ROWS = 256
# Bound of the epipolar residual of a guided match, standard deviations.
MAX_EPIPOLAR_SIGMA = 3.0
# Largest distance of SIFT descriptors of unit length, as in COLMAP (99 % of the correct matches are within 0.4), and
# largest share of different bits of binary descriptors (99 % are within 0.18; 0.5 is expected by chance).
MAX_DISTANCE, MAX_BIT_SHARE = 0.7, 0.25


@dataclass(frozen=True, eq=False)
class Matches(Displayed):
    """Matches between the keypoints of two images.

    Attributes
    ----------
    pairs
        (M, 2) indices into the keypoints of the first and of the second image, in the order of the first.
    ratio
        (M,) distance of the descriptors relative to that of the second nearest; small is distinctive.
    """

    pairs: NDArray[np.intp]
    ratio: Array

    def __len__(self) -> int:
        return len(self.pairs)

    def __repr__(self) -> str:
        return f"Matches({len(self)})"


def match_features(a: Keypoints, b: Keypoints, ratio: float = 0.8) -> Matches:
    """Match keypoints that are mutually nearest by their descriptors.

    Parameters
    ----------
    a, b
        Keypoints of two images, detected with the same kind of descriptor.
    ratio
        Largest distance of the descriptors (Euclidean, or Hamming of binary descriptors) relative to that of the
        second nearest in `b` (Lowe 2004).

    Raises
    ------
    ValueError
        If the descriptors are of different kinds.
    """
    return _match(a, b, ratio, None)


def match_guided(a: Keypoints, b: Keypoints, b_from_a: Pose, sigma: float = 0.0, ratio: float = 0.8) -> Matches:
    """Match keypoints along epipolar curves.

    Only keypoints of `b` near the epipolar curve of a keypoint of `a`, at positive distances from both cameras,
    are compared. The first-order (Sampson) error of the bearings to the epipolar constraint is at most 3 standard
    deviations. Fewer keypoints compete than without guidance, so more pass the ratio test.

    Parameters
    ----------
    a, b
        Keypoints of two images, detected with the same kind of descriptor.
    b_from_a
        Pose of the cameras, x_b = R x_a + t; the length of t has no effect.
    sigma
        Standard deviation of the pose as an angle in radians, added to the covariance of the bearings of `b`.
    ratio
        As in `match_features`.

    Raises
    ------
    ValueError
        If the descriptors are of different kinds, or the translation is zero: there are no epipolar curves.
    """
    length = float(np.linalg.norm(b_from_a.translation))
    if not length > 0:
        raise ValueError("the translation of b_from_a is zero, so there are no epipolar curves: use match_features")
    t = b_from_a.translation / length
    return _match(a, b, ratio, _on_epipolar_curves(a, b, b_from_a.rotation, t, sigma))


def _match(a: Keypoints, b: Keypoints, ratio: float, admissible: Admissible | None) -> Matches:
    """Return the matches of mutually nearest keypoints that pass the ratio test."""
    _check_descriptors(a, b)
    if not len(a) or not len(b):
        return Matches(np.zeros((0, 2), np.intp), np.zeros(0))
    nearest, similarity, second, best_of_b = _compare(a, b, admissible)
    binary = a.descriptors.dtype == np.uint8
    limit = MAX_BIT_SHARE if binary else MAX_DISTANCE
    distance, next_distance = (
        (1 - s) / 2 if binary else np.sqrt(np.maximum(2 - 2 * s, MIN_SQUARED_DISTANCE)) for s in (similarity, second)
    )
    mutual = similarity >= best_of_b[nearest]
    rows = np.flatnonzero(mutual & (distance <= limit) & (distance < ratio * next_distance))
    pairs = np.stack([rows, nearest[rows]], -1)
    ratios = (distance[rows] / next_distance[rows]).astype(float)
    unique = _one_match_per_location(a, b, pairs, ratios)
    return Matches(pairs[unique], ratios[unique])


def _compare(
    a: Keypoints, b: Keypoints, admissible: Admissible | None
) -> tuple[NDArray[np.intp], Floats, Floats, Floats]:
    """Compare all descriptors by their cosine similarity.

    Returns
    -------
    nearest
        (N,) index of the most similar keypoint of `b` for each of `a`.
    similarity, second
        (N,) similarity to it and to the second most similar; -inf if there is none.
    best_of_b
        (M,) the largest similarity of each keypoint of `b`.
    """
    of_a, of_b = _unit_vectors(a.descriptors), _unit_vectors(b.descriptors)
    nearest = np.zeros(len(a), np.intp)
    similarity, second = (np.full(len(a), -np.inf, np.float32) for _ in range(2))
    best_of_b = np.full(len(b), -np.inf, np.float32)
    for start in range(0, len(a), BLOCK_ROWS):
        rows = slice(start, start + BLOCK_ROWS)
        block = of_a[rows] @ of_b.T
        if admissible is not None:
            block[~admissible(rows)] = -np.inf
        column = block.argmax(1)
        at_nearest = np.arange(len(block)), column
        nearest[rows], similarity[rows] = column, block[at_nearest]
        np.maximum(best_of_b, block.max(0), out=best_of_b)
        block[at_nearest] = -np.inf
        second[rows] = block.max(1)
    return nearest, similarity, second, best_of_b


def _check_descriptors(a: Keypoints, b: Keypoints) -> None:
    kinds = [(k.descriptors.dtype, k.descriptors.shape[1]) for k in (a, b)]
    if kinds[0] != kinds[1]:
        raise ValueError(f"descriptors of different kinds: {a!r} and {b!r}; detect both with the same `kind`")


def _unit_vectors(descriptors: NDArray[Any]) -> Floats:
    """Return descriptors as unit vectors (N, D): bits become ±1, for which 1 - 2 h/D is the similarity."""
    if descriptors.dtype != np.uint8:
        return descriptors
    bits = np.unpackbits(descriptors, axis=1).astype(np.float32)
    return (2 * bits - 1) / np.float32(np.sqrt(bits.shape[1]))


def _one_match_per_location(a: Keypoints, b: Keypoints, pairs: NDArray[np.intp], ratios: Array) -> NDArray[np.intp]:
    """Return the matches to keep: a location can have several orientations, but moves to one other location."""
    keep = np.argsort(ratios, kind="stable")
    for keypoints, side in ((a, 0), (b, 1)):
        pixels = keypoints.pixels[pairs[keep, side]]
        _, first = np.unique(pixels[:, 0] + 1j * pixels[:, 1], return_index=True)
        keep = keep[np.sort(first)]
    return np.sort(keep)


def _on_epipolar_curves(a: Keypoints, b: Keypoints, rotation: Array, t: Array, sigma: float) -> Admissible:
    """Return the function that decides which pairs fulfil the epipolar constraint at positive distances."""
    essential = hat(t) @ rotation
    turned, bearings = (np.asarray(x, np.float32) for x in (a.bearings @ rotation.T, b.bearings))
    normals_in_b, normals_in_a = a.bearings @ essential.T, b.bearings @ essential
    covariance_a, covariance_b = _flat(a.covariance), _flat(b.covariance + sigma**2 * np.eye(3))
    outer_a, outer_b = (_flat(n[:, :, None] * n[:, None, :]) for n in (normals_in_a, normals_in_b))
    along_a, along_b = turned @ t.astype(np.float32), bearings @ t.astype(np.float32)
    sigma_a, sigma_b = (np.sqrt(c[:, [0, 4, 8]].sum(1) / 2) for c in (covariance_a, covariance_b))

    def admissible(rows: slice) -> NDArray[np.bool_]:
        residual = normals_in_b[rows].astype(np.float32) @ bearings.T
        variance = outer_b[rows] @ covariance_b.T + covariance_a[rows] @ outer_a.T
        near = residual**2 <= MAX_EPIPOLAR_SIGMA**2 * variance
        i, j = np.nonzero(near)  # few pairs
        near[i, j] = at_positive_distances(i + rows.start, j)
        return near

    def at_positive_distances(i: NDArray[np.intp], j: NDArray[np.intp]) -> NDArray[np.bool_]:
        # Distances from both cameras times the squared sine of the parallax. Without parallax their signs are noise.
        cosine = np.einsum("ni,ni->n", turned[i], bearings[j])
        chord = np.linalg.norm(turned[i] - bearings[j], axis=1)
        noise = MAX_EPIPOLAR_SIGMA * np.hypot(sigma_a[i], sigma_b[j])
        return ((cosine * along_b[j] > along_a[i]) & (along_b[j] > cosine * along_a[i])) | (chord < noise)

    return admissible


def _flat(matrices: Array) -> Floats:
    return matrices.reshape(-1, 9).astype(np.float32)
