"""Relative poses of places that only look alike: their images have too few common points.

Repeated structure, such as the same chairs and windows in every room, agrees with a relative pose as well as true
matches do. But from the estimated place the other points of the image would be visible too, and they do not match (C.
Zach et al., What can missing correspondences tell us about 3D structure and motion?, CVPR 2008).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.parallel import parallel_map
from omnisight.sfm.incidence import spanning_tree, unique_edges
from omnisight.sfm.scale_averaging import PointDistances, average_log_scales
from omnisight.sfm.spanning_forest import SpanningForest
from omnisight.sfm.view_graph import Edge

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Distance of a predicted direction from the nearest keypoint, in units of the median distance of keypoints from each
# other: farther away, the image may not show the surface.
MAX_GAP = 2.0
# Cells along each edge of a cube on which the distances from an image are tabulated; a cell is 1.9 degrees wide. The
# radius is that of the largest cells.
CELLS = 48
CELL_RADIUS_RAD = float(np.pi / 4 / CELLS * np.sqrt(2))
# Expected matches below which a pair is not tested, as a number and as a share of those of all keypoints: at the rim of
# a fisheye few points match.
MIN_EXPECTED, MIN_VISIBLE_SHARE = 30, 0.1
# Matches as a share of the expected ones: correct edges of images 9.6 m apart in a rendered street have 0.24 or more,
# and edges between different rooms with the same furniture 0.23 or less, if 500 or more matches are expected.
MIN_SHARE = 1 / 4
# Least support of an edge, matches: if it lacks more than it has, only edges that nothing else replaces count.
MIN_SUPPORT = 1.0
# Least share of the predicted keypoints that match in images from one place: 0.2 on photos of white walls, 0.4 or more
# on rendered images.
MIN_REPEATABILITY = 0.15


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Keypoints of an image with their distances, or those of the nearest keypoints whose distances are known.

    Attributes
    ----------
    bearings, distances
        (N, 3) and (N,).
    farthest
        (6 CELLS^2,) distance in each cell of the sphere; 0 without a keypoint.
    """

    bearings: Array
    distances: Array
    farthest: Array

    @classmethod
    def of(cls, bearings: Array, known: Indices, distances: Array) -> Self:
        """Return the keypoints (K, 3) of an image, and the known distances of some (N,)."""
        distances = distances[KDTree(bearings[known]).query(bearings)[1]]
        tree = KDTree(bearings)
        spacing = tree.query(bearings, k=2)[0][:, 1] if len(bearings) > 1 else np.zeros(1)
        reach = MAX_GAP * float(np.median(spacing)) + CELL_RADIUS_RAD
        nearest = tree.query(_cell_centers(), distance_upper_bound=reach)[1]
        return cls(bearings, distances, np.append(distances, 0.0)[nearest])

    @classmethod
    def at_infinity(cls, bearings: Array) -> Self:
        """Return keypoints (K, 3) whose directions change only with the rotation of the camera."""
        return cls.of(bearings, np.arange(len(bearings)), np.ones(len(bearings)))

    def visible_from(self, other: "KnownPoints", pose: Pose) -> tuple[Indices, float]:
        """Return the keypoints that another image with a pose other_from_this should match, and how many will.

        It sees them in a similar direction, at a similar distance, and past its own points. The number is relative to
        that in images from one place.
        """
        from omnisight.sfm._visibility_kernel import mark_visible

        seen = np.empty(len(self.bearings), bool)
        number = mark_visible(
            self.bearings, self.distances, pose.rotation, pose.translation, other.farthest, CELLS, seen
        )
        return np.flatnonzero(seen), number


class PredictedMatches(NamedTuple):
    """Matches that a relative pose predicts.

    Attributes
    ----------
    predicted
        Number if all keypoints were detected in both images.
    found
        Number of matches among them.
    matches
        Number of all matches of the pair.
    keypoints
        The smaller number of keypoints of the two images.
    """

    predicted: float
    found: float
    matches: int
    keypoints: int


class ComparedImages(NamedTuple):
    """Pairs of images (N, 2) that were compared, and the matches that their poses predict."""

    pairs: Indices
    predictions: Sequence[PredictedMatches]


def predicted_matches_of_edges(edges: Sequence[Edge], points: PointDistances) -> list[PredictedMatches]:
    """Return the matches that the relative poses of edges with a translation predict."""
    if not edges:
        return []
    table = points.table(edges)
    log_scales, _, _ = average_log_scales(table)
    known = known_points(points, table.medians(log_scales))

    def predict(edge: Edge, scale: float) -> PredictedMatches:
        b_from_a = Pose(edge.b_from_a.rotation, scale * edge.b_from_a.translation)
        return predicted_matches(known[edge.a], known[edge.b], b_from_a, edge.pairs)

    return parallel_map(lambda pair: predict(*pair), list(zip(edges, np.exp(log_scales), strict=True)))


def predicted_matches_of_poses(
    pairs: Sequence[tuple[int, int]],
    matches: Sequence[Indices],
    known: Mapping[int, KnownPoints] | Sequence[KnownPoints | None],
    cam_from_world: Mapping[int, Pose],
) -> list[PredictedMatches]:
    """Return the matches that the poses of pairs of images predict, given those (M, 2) that each pair has."""

    def predict(k: int) -> PredictedMatches:
        a, b = pairs[k]
        return predicted_matches(known[a], known[b], cam_from_world[b] @ cam_from_world[a].inverse(), matches[k])

    return parallel_map(predict, range(len(pairs)))


def predicted_matches(a: KnownPoints | None, b: KnownPoints | None, b_from_a: Pose, pairs: Indices) -> PredictedMatches:
    """Return the matches of two images that their relative pose predicts, and how many of them are pairs (M, 2)."""
    if a is None or b is None:
        return PredictedMatches(0.0, 0.0, 0, 0)
    in_a, of_a = a.visible_from(b, b_from_a)
    in_b, of_b = b.visible_from(a, b_from_a.inverse())
    found = np.isin(pairs[:, 0], in_a).sum() + np.isin(pairs[:, 1], in_b).sum()
    keypoints = min(len(a.bearings), len(b.bearings))
    return PredictedMatches(0.5 * (of_a + of_b), 0.5 * float(found), len(pairs), keypoints)


def predicted_matches_of_edge(edge: Edge, keypoints: Sequence[Keypoints]) -> PredictedMatches:
    """Return the matches that the relative pose of an edge predicts on its own, without those of other edges.

    All points are at infinity if the direction of its translation or all distances are unknown.
    """
    ends = [keypoints[image] for image in edge.images]
    moving = replace(edge, a=0, b=1)
    points = PointDistances(ends)
    if edge.has_translation and points.of([moving])[0].keypoint.size:
        of_a, of_b = known_points(points, points.table([moving]).medians(np.zeros(1)))
        return predicted_matches(of_a, of_b, edge.b_from_a, edge.pairs)
    a, b = (KnownPoints.at_infinity(each.bearings) for each in ends)
    return predicted_matches(a, b, Pose(edge.b_from_a.rotation), edge.pairs)


def missing_matches(predictions: Sequence[PredictedMatches], repeatability: float) -> Array:
    """Return the number of matches (N,) that pairs of images lack for their relative poses; 0 if not significant."""
    predicted, found, _, keypoints = np.array(predictions, float).reshape(-1, 4).T
    expected = repeatability * predicted
    least = np.maximum(MIN_EXPECTED, MIN_VISIBLE_SHARE * repeatability * keypoints)
    return np.where((expected >= least) & (found < MIN_SHARE * expected), expected - found, 0.0)


def supporting_matches(edges: Sequence[Edge], predictions: Sequence[PredictedMatches], repeatability: float) -> Array:
    """Return the number of matches (E,) of each edge minus that of the missing ones.

    Facades that look alike have hundreds of matches, but half of those that one place has: in a rendered town, edges
    between different places have up to 0.54 of the expected matches, and those of images 2 m apart 0.86 or more.
    """
    predicted, found, _, _ = np.array(predictions, float).reshape(-1, 4).T
    missing = np.maximum(repeatability * predicted - found, 0.0)
    return np.maximum([len(edge.pairs) for edge in edges] - missing, MIN_SUPPORT)


def repeatability(pairs: Sequence[tuple[int, int]], predictions: Sequence[PredictedMatches]) -> float:
    """Return the share of the predicted keypoints that match: the median of some pairs, weighted by their matches.

    It is the pair of each image with most matches. These pairs are right where most others are wrong, such as 80 of 100
    pairs of images 2 to 4.6 m apart in rooms with the same furniture.
    """
    predicted, found, matches, _ = np.array(predictions, float).reshape(-1, 4).T
    order = np.argsort(-matches, kind="stable")
    ends = np.array(pairs, np.intp).reshape(-1, 2)[order]
    best = np.unique(order[np.unique(ends, return_index=True)[1] // 2])
    use = best[predicted[best] >= MIN_EXPECTED]
    if not found[use].any():
        return MIN_REPEATABILITY
    share = found[use] / predicted[use]
    rank = np.argsort(share)
    total = np.cumsum(matches[use][rank])
    median = share[rank][np.searchsorted(total, 0.5 * total[-1])]
    return float(np.clip(median, MIN_REPEATABILITY, 1.0))


class Links(NamedTuple):
    """Pairs of frames (N,), and the number of matches that each has or lacks."""

    a: Indices
    b: Indices
    matches: Array

    def select(self, use: NDArray[np.bool_]) -> Self:
        """Return the pairs of a mask (N,)."""
        return type(self)(self.a[use], self.b[use], self.matches[use])


def contradicted_links(count: int, links: Links, missing: Links) -> NDArray[np.bool_]:
    """Return which links (N,) of frames place two parts of a map where more matches are missing than agree.

    The two parts are those that an edge of the spanning tree with most matches connects. Of all such pairs of parts,
    the one with the largest share of missing matches is selected; none if all have more matches.
    """
    if not len(missing.a):
        return np.zeros(len(links.a), bool)
    best = unique_edges(links.a, links.b, -links.matches)
    a, b = links.a[best], links.b[best]
    tree = spanning_tree(count, a, b, 1 / links.matches[best])
    forest = SpanningForest.of(count, a[tree], b[tree])
    agreeing, lacking = forest.sums_across(*links), forest.sums_across(*missing)
    ratio = lacking / np.maximum(agreeing, 1.0)  # nodes without an edge separate nothing
    worst = int(ratio.argmax())
    return forest.separates(worst, links.a, links.b) & (ratio[worst] > 1.0)


def known_points(points: PointDistances, log_distances: Array) -> list[KnownPoints | None]:
    """Return the keypoints of each image with known logarithms of distances, NaN if unknown; None without any."""

    def of_image(image: int) -> KnownPoints | None:
        distances = np.exp(log_distances[points.offsets[image] : points.offsets[image + 1]])
        known = np.flatnonzero(np.isfinite(distances))
        return KnownPoints.of(points.keypoints[image].bearings, known, distances[known]) if len(known) else None

    return parallel_map(of_image, range(len(points.keypoints)))


@cache
def _cell_centers() -> Array:
    """Return the directions (6 CELLS^2, 3) of the centres of the cells."""
    across = np.tan(((np.arange(CELLS) + 0.5) * (2 / CELLS) - 1) * (np.pi / 4))
    first, second = np.meshgrid(across, across, indexing="ij")
    faces = [
        np.roll(np.stack([np.full_like(first, sign), first, second], -1).reshape(-1, 3), axis, axis=1)
        for axis in range(3)
        for sign in (1.0, -1.0)
    ]
    directions = np.concatenate(faces)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
