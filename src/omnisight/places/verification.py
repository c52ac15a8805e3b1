"""Geometric verification of places: whether two images show one place, or similar ones."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.display import named_tuple_text
from omnisight.features import Keypoints, match_features
from omnisight.optim.ransac import RansacOptions
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose

Array = NDArray[np.float64]

# Directions that are counted: cells of the sphere of 40 degrees, in each of which an image has some keypoints.
DIRECTIONS = 24
# Keypoints of an image, and inliers, from which a direction counts.
MIN_KEYPOINTS, MIN_INLIERS = 5, 3
# Matches from which a relative pose is estimated.
MIN_MATCHES = 8


class PlaceMatch(NamedTuple):
    """Evidence that two images show one place.

    Attributes
    ----------
    matches, inliers
        Number of matches, and of those that agree with a relative pose.
    directions
        Share of the directions with keypoints in which matches agree, that of the image where it is smaller. Similar
        facades of different places agree in one direction only.
    """

    matches: int
    inliers: int
    directions: float

    __repr__ = named_tuple_text


def verify_place(a: Keypoints, b: Keypoints) -> PlaceMatch:
    """Match two images, and estimate how far they agree with a relative pose.

    Parameters
    ----------
    a, b
        Keypoints of one kind, in images of any cameras.

    Raises
    ------
    ValueError
        If the descriptors are of different kinds.
    """
    pairs = match_features(a, b).pairs
    if len(pairs) < MIN_MATCHES:
        return PlaceMatch(len(pairs), 0, 0.0)
    of_a, of_b = a[pairs[:, 0]], b[pairs[:, 1]]
    bearings = BearingPairs(of_a.bearings, of_b.bearings, of_a.covariance, of_b.covariance, is_noise_known=False)
    found = estimate_relative_pose(bearings, RansacOptions())
    if not found:
        return PlaceMatch(len(pairs), 0, 0.0)
    share = min(agreeing_directions(k.bearings, seen.bearings[found.inliers]) for k, seen in ((a, of_a), (b, of_b)))
    return PlaceMatch(len(pairs), int(found.inliers.sum()), share)


def agreeing_directions(keypoints: Array, inliers: Array) -> float:
    """Return the share of the directions with keypoints in which there are inliers, given bearings (N, 3) of both."""
    centers = even_directions(DIRECTIONS)
    of_keypoints, of_inliers = (
        np.bincount((bearings @ centers.T).argmax(axis=1), minlength=DIRECTIONS) for bearings in (keypoints, inliers)
    )
    counted = of_keypoints >= MIN_KEYPOINTS
    return float((of_inliers[counted] >= MIN_INLIERS).mean()) if counted.any() else 0.0


def even_directions(count: int) -> Array:
    """Return directions (count, 3) of nearly equal density: a Fibonacci lattice."""
    i = np.arange(count) + 0.5
    y, turn = 1 - 2 * i / count, np.pi * (1 + np.sqrt(5)) * i
    radius = np.sqrt(1 - y**2)
    return np.stack([radius * np.sin(turn), y, radius * np.cos(turn)], -1)
