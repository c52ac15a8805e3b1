"""The view graph: images, and the relative poses of pairs of images that overlap."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints, match_features
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.parallel import parallel_map
from omnisight.progress import StageProgress
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import RelativePose, estimate_relative_pose, known_relative_pose

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Matches that agree with a relative pose, below which an edge is not reliable: a pose has five degrees of freedom, and
# repeated structure agrees by more than chance.
MIN_INLIERS = 20
# 5000 samples of five contain one of inliers only, with 99 % probability, if 25 % of the matches are inliers.
SEARCH = RansacOptions(max_iterations=5000)
# Keypoints of each image, the strongest, that decide whether a pair is worth matching, and matches among them (C. Wu,
# Towards linear-time incremental structure from motion, 3DV 2013).
PREEMPTIVE_KEYPOINTS, MIN_PREEMPTIVE_MATCHES = 300, 6


@dataclass(frozen=True, eq=False)
class Edge:
    """Two images with an estimated relative pose.

    Attributes
    ----------
    a, b
        Indices of the images.
    b_from_a, covariance
        The relative pose, and the covariance (6, 6) of its step; see `RelativePose`.
    motion
        Name of its motion model.
    pairs
        (N, 2) indices of the keypoints of the inliers.
    """

    a: int
    b: int
    b_from_a: Pose
    covariance: Array
    motion: str
    pairs: Indices

    @property
    def images(self) -> tuple[int, int]:
        """The images."""
        return self.a, self.b

    @property
    def has_translation(self) -> bool:
        """Whether the direction of the translation is known."""
        return self.motion not in ("rotation only", "insufficient parallax", "ambiguous", "no overlap")


@dataclass(frozen=True, eq=False)
class ViewGraph:
    """Images and their relative poses.

    Attributes
    ----------
    edges
        Pairs of images that overlap.
    compared
        All pairs that were matched.
    support
        Number of matches that support an edge, if it is not that of its matches.
    repeatability
        Share of the keypoints that match in images from one place.
    """

    edges: list[Edge]
    compared: list[tuple[int, int]]
    support: Mapping[Edge, float] = field(default_factory=dict)
    repeatability: float = 1.0

    @cached_property
    def matches(self) -> dict[tuple[int, int], Indices]:
        """Keypoints (N, 2) of the inliers of each pair of images with an edge."""
        return {edge.images: edge.pairs for edge in self.edges}

    def matches_of(self, a: int, b: int) -> Indices:
        """Return the keypoints (N, 2) of the inliers of two images; none if they have no edge."""
        pairs = self.matches.get((a, b))
        return self.matches.get((b, a), np.zeros((0, 2), np.intp))[:, ::-1] if pairs is None else pairs

    def without_images(self, left_out: NDArray[np.bool_]) -> "ViewGraph":
        """Return the view graph without the images of a mask (I,)."""
        edges = [edge for edge in self.edges if not left_out[list(edge.images)].any()]
        return replace(self, edges=edges, compared=[pair for pair in self.compared if not left_out[list(pair)].any()])

    def support_of(self, edges: Sequence[Edge]) -> Array:
        """Return the number of matches (E,) that support each edge."""
        return np.array([self.support.get(edge, len(edge.pairs)) for edge in edges], float)


def match_pairs(
    keypoints: Sequence[Keypoints],
    pairs: Sequence[tuple[int, int]],
    progress: StageProgress,
    known: Callable[[int, int], Pose | None] = lambda a, b: None,
) -> ViewGraph:
    """Match pairs of images and estimate those of their relative poses that are not known.

    Pairs that do not overlap have no edge.
    """
    found = parallel_map(lambda pair: match_pair(keypoints, *pair, known(*pair)), pairs, progress)
    return ViewGraph([edge for edge in found if edge is not None], list(pairs))


def match_pair(
    keypoints: Sequence[Keypoints], a: int, b: int, known: Pose | None = None, *, without: Indices | None = None
) -> Edge | None:
    """Match two images and estimate their relative pose, or take the known one; return None if they do not overlap.

    Parameters
    ----------
    keypoints
        Keypoints of all images.
    a, b
        Indices of the images.
    known
        Their relative pose, if it is known.
    without
        (M, 2) matches that are left out.
    """
    matches = match_features(keypoints[a], keypoints[b]).pairs
    if without is not None:
        matches = matches[~(np.isin(matches[:, 0], without[:, 0]) | np.isin(matches[:, 1], without[:, 1]))]
    if len(matches) < MIN_INLIERS:
        return None
    pose = _relative_pose(keypoints[a], keypoints[b], matches, known)
    if pose.motion.name == "ambiguous":
        # The best of several poses; if it is wrong, matches will be missing, see `without_contradicted_edges`.
        matches = matches[pose.inliers]
        pose = _relative_pose(keypoints[a], keypoints[b], matches, known)
    if pose.b_from_a is None or pose.inliers.sum() < MIN_INLIERS:
        return None
    return Edge(a, b, pose.b_from_a, pose.covariance, pose.motion.name, matches[pose.inliers])


def _relative_pose(a: Keypoints, b: Keypoints, matches: Indices, known: Pose | None) -> RelativePose:
    """Estimate the relative pose of two images from matches (M, 2), or take the known one."""
    a, b = a[matches[:, 0]], b[matches[:, 1]]
    pairs = BearingPairs.of(a.bearings, b.bearings, a.covariance, b.covariance, None)
    if known is not None:
        return known_relative_pose(pairs, known)
    return estimate_relative_pose(replace(pairs, is_noise_known=False), SEARCH)


def overlapping_pairs(
    keypoints: Sequence[Keypoints], pairs: Sequence[tuple[int, int]], progress: StageProgress
) -> list[tuple[int, int]]:
    """Return the pairs whose strongest keypoints match."""
    strongest = [each[:PREEMPTIVE_KEYPOINTS] for each in keypoints]

    def matches(pair: tuple[int, int]) -> bool:
        return len(match_features(strongest[pair[0]], strongest[pair[1]]).pairs) >= MIN_PREEMPTIVE_MATCHES

    return [pair for pair, keep in zip(pairs, parallel_map(matches, pairs, progress), strict=True) if keep]
