"""Edges between places that only look alike: their images have too few common points.

Repeated structure, such as the same chairs and windows in every room, agrees with a relative pose as well as true
matches do. But from the estimated place the other points of the image would be visible too, and they do not match (C.
Zach et al., What can missing correspondences tell us about 3D structure and motion?, CVPR 2008).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.parallel import parallel_map
from omnisight.sfm.incidence import spanning_tree, unique_edges
from omnisight.sfm.position_averaging import EdgeDistances, average_log_scales, edge_distances
from omnisight.sfm.view_graph import Edge

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Change of the direction to a point, and of the logarithm of its distance, up to which descriptors match well.
MAX_TURN_RAD, MAX_LOG_RATIO = float(np.radians(15.0)), float(np.log(1.3))
# Distance of a predicted direction from the nearest keypoint of known distance, in units of the median distance of such
# keypoints from each other: farther away, the image may not show the surface.
MAX_GAP = 2.0
# Predicted points below which a pair is not tested, as a number and as a share of the points of an image: at the rim of
# a fisheye few points match.
MIN_PREDICTED, MIN_VISIBLE_SHARE = 50, 0.1
# Matches as a share of the predicted points: correct edges have 0.41 or more in a rendered town and 0.79 or more in
# rooms, and three quarters of the edges between different rooms have less than 0.19.
MIN_SHARE = 1 / 3


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Keypoints of an image whose distances are known.

    Attributes
    ----------
    bearings, distances
        (N, 3) and (N,).
    tree
        Of the bearings.
    spacing
        Median distance of a bearing from the nearest other one.
    """

    bearings: Array
    distances: Array
    tree: KDTree
    spacing: float

    @classmethod
    def of(cls, bearings: Array, distances: Array) -> Self:
        """Return the keypoints of an image with bearings (N, 3) and distances (N,)."""
        tree = KDTree(bearings)
        spacing = tree.query(bearings, k=2)[0][:, 1:]
        return cls(
            bearings, distances, tree, float(np.median(spacing[np.isfinite(spacing)])) if len(bearings) > 1 else 0.0
        )

    def visible_from(self, other: "KnownPoints", pose: Pose) -> int:
        """Return the number of points that another image with a pose other_from_this should match.

        It sees them in nearly the same direction, at nearly the same distance, and past its own points.
        """
        points = pose @ (self.bearings * self.distances[:, None])
        distances = np.linalg.norm(points, axis=1)
        directions = points / np.maximum(distances, 1e-300)[:, None]
        turns = np.einsum("ni,ni->n", directions, self.bearings @ pose.rotation.T)
        similar = turns >= np.cos(MAX_TURN_RAD)
        similar &= np.abs(np.log(np.maximum(distances, 1e-300) / self.distances)) <= MAX_LOG_RATIO
        gap, nearest = other.tree.query(directions[similar], distance_upper_bound=MAX_GAP * other.spacing)
        seen = np.isfinite(gap)
        return int((other.distances[nearest[seen]] >= distances[similar][seen] * np.exp(-MAX_LOG_RATIO)).sum())


def pairs_with_missing_matches(edges: Sequence[Edge], keypoints: Sequence[Keypoints]) -> set[tuple[int, int]]:
    """Return the edges whose images would share far more points if their relative pose were right."""
    moving = [edge for edge in edges if edge.has_translation]
    if not moving:
        return set()
    distances = [edge_distances(edge, keypoints) for edge in moving]
    log_scales, _, _ = average_log_scales(distances)
    known = known_points(distances, log_scales, keypoints)

    def missing(edge: Edge, scale: float) -> float:
        b_from_a = Pose(edge.b_from_a.rotation, scale * edge.b_from_a.translation)
        return missing_matches(known[edge.a], known[edge.b], b_from_a, len(edge.pairs))

    found = parallel_map(lambda pair: missing(*pair), list(zip(moving, np.exp(log_scales), strict=True)))
    return {edge.images for edge, count in zip(moving, found, strict=True) if count}


def missing_matches(a: KnownPoints | None, b: KnownPoints | None, b_from_a: Pose, matches: int) -> float:
    """Return the number of matches that two images lack for their relative pose; 0 if it is not significant."""
    if a is None or b is None:
        return 0.0
    predicted = 0.5 * (a.visible_from(b, b_from_a) + b.visible_from(a, b_from_a.inverse()))
    least = max(MIN_PREDICTED, MIN_VISIBLE_SHARE * min(len(a.distances), len(b.distances)))
    return predicted - matches if predicted >= least and matches < MIN_SHARE * predicted else 0.0


class Links(NamedTuple):
    """Pairs of frames (N,), and the number of matches that each has or lacks."""

    a: Indices
    b: Indices
    matches: Array


def contradicted_links(count: int, links: Links, missing: Links) -> NDArray[np.bool_]:
    """Return which links (N,) of frames place two parts of a map where more matches are missing than agree.

    The two parts are those that an edge of the spanning tree with most matches connects. Of all such pairs of parts,
    the one with the largest share of missing matches is selected; none if all have more matches.
    """
    best = unique_edges(links.a, links.b, -links.matches)
    a, b = links.a[best], links.b[best]
    tree = spanning_tree(count, a, b, 1 / links.matches[best])
    largest, found = 1.0, np.zeros(len(links.a), bool)
    for edge in tree if len(missing.a) else ():
        others = tree[tree != edge]
        graph = coo_array((np.ones(len(others)), (a[others], b[others])), shape=(count, count))
        part = connected_components(graph, directed=False)[1] == 0
        across = part[links.a] != part[links.b]
        lacking = missing.matches[part[missing.a] != part[missing.b]].sum()
        if lacking > largest * links.matches[across].sum():
            largest, found = lacking / links.matches[across].sum(), across
    return found


def known_points(
    distances: Sequence[EdgeDistances], log_scales: Array, keypoints: Sequence[Keypoints]
) -> list[KnownPoints | None]:
    """Return the keypoints of each image with the medians of their distances from all edges; None without any."""
    image, keypoint = (np.concatenate([getattr(each, name) for each in distances]) for name in ("camera", "keypoint"))
    logarithm = np.concatenate([each.log_distance + scale for each, scale in zip(distances, log_scales, strict=True)])
    order = np.lexsort((logarithm, keypoint, image))
    image, keypoint, logarithm = image[order], keypoint[order], logarithm[order]
    starts = np.flatnonzero(np.append(True, (np.diff(image) != 0) | (np.diff(keypoint) != 0)))
    middle = (starts + np.append(starts[1:], len(image))) // 2
    found: list[KnownPoints | None] = [None] * len(keypoints)
    for i in np.unique(image):
        use = image[starts] == i
        found[i] = KnownPoints.of(keypoints[i].bearings[keypoint[starts[use]]], np.exp(logarithm[middle[use]]))
    return found
