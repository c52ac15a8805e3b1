"""Matches between the lenses of a head, and between its frames, as pixels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import FeatureOptions, Keypoints, detect_features, match_features
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Keypoints of each image; those of the rim, where another lens sees the same, are at least half of the disc's area.
MAX_KEYPOINTS = 6000
# Random pairs of matches from which rotations are computed: with 10 % inliers one of 100 pairs is correct.
ROTATION_SAMPLES = 3000
# Frames on each side that a frame is matched with.
NEIGHBOURS = 1
# Parallax, and errors of the profile, are common to neighbouring matches: the overlap of a frame, and a motion between
# two frames, have about as many independent ones.
INDEPENDENT_MATCHES = 30


@dataclass(frozen=True, eq=False)
class OverlapMatches:
    """Matches of the first and another lens in all frames.

    Attributes
    ----------
    first, other
        (N, 2) pixels of both lenses.
    frame
        (N,) index of the frame.
    """

    first: Array
    other: Array
    frame: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.first)

    @property
    def correlation(self) -> float:
        """Number of matches for each independent one: the factor of variances computed as for independent matches."""
        return max(1.0, len(self) / (INDEPENDENT_MATCHES * len(np.unique(self.frame))))

    def select(self, rows: Any) -> "OverlapMatches":
        """Return some of the matches."""
        return OverlapMatches(self.first[rows], self.other[rows], self.frame[rows])


def detect_in_lenses(
    images: Sequence[Sequence[NDArray[Any]]], cameras: Sequence[Camera], masks: Sequence[Mask]
) -> list[list[Keypoints]]:
    """Detect keypoints of frames x lenses."""
    options = FeatureOptions(max_keypoints=MAX_KEYPOINTS)
    return [
        [
            detect_features(image, camera, options, mask=mask)
            for image, camera, mask in zip(frame, cameras, masks, strict=True)
        ]
        for frame in images
    ]


def match_overlap(keypoints: Sequence[tuple[Keypoints, Keypoints]]) -> OverlapMatches:
    """Match keypoints of two lenses in each frame, without knowledge of their rotation."""
    return _joined([(a, b, match_features(a, b).pairs) for a, b in keypoints])


def match_frames(
    keypoints: Sequence[Sequence[Keypoints]],
) -> list[tuple[int, int, list[tuple[Array, Array]]]]:
    """Match consecutive frames: both indices, and for each lens the pixels (N, 2) in both."""
    found: list[tuple[int, int, list[tuple[Array, Array]]]] = []
    for i in range(len(keypoints) - 1):
        lenses: list[tuple[Array, Array]] = []
        for a, b in zip(keypoints[i], keypoints[i + NEIGHBOURS], strict=True):
            pairs = match_features(a, b).pairs
            lenses.append((a.pixels[pairs[:, 0]], b.pixels[pairs[:, 1]]))
        found.append((i, i + NEIGHBOURS, lenses))
    return found


def best_rotation(a: Array, b: Array, tolerance: float, rng: np.random.Generator) -> tuple[Array, Mask]:
    """Return the rotation b_from_a (3, 3) with which most bearings (N, 3) agree within a tolerance (radians)."""
    count = len(a)
    if count < 2:
        return np.eye(3), np.zeros(count, np.bool_)
    picks = rng.integers(0, count, (ROTATION_SAMPLES, 2))
    # The same angle between both bearings in both images is necessary, and excludes most wrong pairs.
    first, second = picks.T
    angle_a, angle_b = (np.arccos(np.clip((x[first] * x[second]).sum(1), -1, 1)) for x in (a, b))
    picks = picks[(np.abs(angle_a - angle_b) < 2 * tolerance) & (angle_a > 0.1)]
    if not len(picks):
        return np.eye(3), np.zeros(count, np.bool_)
    rotations = so3.nearest(_two_point_moments(a[picks], b[picks]))
    agree = np.einsum("mij,nj,ni->mn", rotations, a, b) > np.cos(tolerance)
    best = int(agree.sum(1).argmax())
    rotation, inliers = rotations[best], agree[best]
    for _ in range(5):
        rotation = so3.nearest(b[inliers].T @ a[inliers])
        inliers = np.einsum("ij,nj,ni->n", rotation, a, b) > np.cos(tolerance)
    return rotation, inliers


def _two_point_moments(a: Array, b: Array) -> Array:
    """Return moment matrices (M, 3, 3) of two bearings each (M, 2, 3) and their normals, which fix the rotation."""
    normal_a, normal_b = (np.cross(x[:, 0], x[:, 1]) for x in (a, b))
    unit_a, unit_b = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in (normal_a, normal_b))
    full_a, full_b = (np.concatenate([x, n[:, None]], axis=1) for x, n in ((a, unit_a), (b, unit_b)))
    return np.einsum("mki,mkj->mij", full_b, full_a)


def _joined(found: Sequence[tuple[Keypoints, Keypoints, NDArray[np.intp]]]) -> OverlapMatches:
    first = [a.pixels[pairs[:, 0]] for a, _, pairs in found]
    other = [b.pixels[pairs[:, 1]] for _, b, pairs in found]
    frame = [np.full(len(pairs), k, np.intp) for k, (_, _, pairs) in enumerate(found)]
    return OverlapMatches(np.concatenate(first), np.concatenate(other), np.concatenate(frame))
