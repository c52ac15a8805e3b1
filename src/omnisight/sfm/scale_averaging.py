"""Relative scales of pairs of images from the distances of their common points.

The distance of a point from a camera is known up to the scale of each pair that triangulates it. Pairs that share a
camera and keypoints thus have known relative scales, also along a straight path, where directions alone do not
determine positions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.optim.block_matrix import BlockPattern
from omnisight.optim.conjugate_gradients import conjugate_gradients
from omnisight.parallel import parallel_map
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.triangulation import triangulate

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Rounds of reweighting: the least sum of lengths (L1) is close after ten.
ROUNDS = 15
# Standard deviation of the logarithm of a distance above which it is not Gaussian, and its mean is wrong.
MAX_LOG_SIGMA = 0.3
# Noise of a logarithm of a scale or distance besides that of triangulation.
MIN_LOG_SIGMA = 0.02


@dataclass(frozen=True, eq=False)
class EdgeDistances:
    """Distances of the points that an edge triangulates with a baseline of length 1, from both cameras.

    Attributes
    ----------
    keypoint
        (D,) int32, different indices among the keypoints of all images.
    log_distance, sigma
        (D,) float32, logarithm, and its standard deviation.
    """

    keypoint: NDArray[np.int32]
    log_distance: NDArray[np.float32]
    sigma: NDArray[np.float32]


class PointDistances:
    """Distances of the points of edges. Each edge is triangulated once.

    Attributes
    ----------
    keypoints
        Keypoints of all images.
    offsets
        (I + 1,) first of the keypoints of each image among those of all.
    """

    def __init__(self, keypoints: Sequence[Keypoints]) -> None:
        self.keypoints = keypoints
        self.offsets = np.cumsum([0, *map(len, keypoints)])
        self._known: dict[Edge, EdgeDistances] = {}

    def of(self, edges: Sequence[Edge]) -> list[EdgeDistances]:
        """Return the distances of the points of each edge."""
        new = [edge for edge in edges if edge not in self._known]
        self._known |= zip(new, parallel_map(self._triangulated, new), strict=True)
        return [self._known[edge] for edge in edges]

    def table(self, edges: Sequence[Edge]) -> "DistanceTable":
        """Return the distances of the points of all edges."""
        return DistanceTable.of(self.of(edges), int(self.offsets[-1]))

    def _triangulated(self, edge: Edge) -> EdgeDistances:
        """Triangulate the inliers of an edge, and return the well-known distances from both cameras."""
        ends = (self.keypoints[edge.a], edge.pairs[:, 0]), (self.keypoints[edge.b], edge.pairs[:, 1])
        poses = [Pose(), edge.b_from_a]
        bearings, covariance = (np.stack([getattr(k, name)[i] for k, i in ends]) for name in ("bearings", "covariance"))
        found = triangulate(poses, bearings, covariance)
        use = np.flatnonzero(found.valid)
        parts: list[tuple[Indices, Array, Array]] = []
        for side, (image, pose) in enumerate(zip(edge.images, poses, strict=True)):
            points = pose @ found.points[use]
            distance = np.linalg.norm(points, axis=1)
            along = (points / distance[:, None]) @ pose.rotation
            variance = np.einsum("ni,nij,nj->n", along, found.covariance[use], along)
            sigma = np.sqrt(np.maximum(variance, 0.0)) / distance
            known = sigma <= MAX_LOG_SIGMA
            keypoint, sigma = self.offsets[image] + edge.pairs[use[known], side], np.hypot(sigma[known], MIN_LOG_SIGMA)
            parts.append((keypoint, np.log(distance[known]), sigma))
        keypoint, log_distance, sigma = (np.concatenate(part) for part in zip(*parts, strict=True))
        return EdgeDistances(keypoint.astype(np.int32), log_distance.astype(np.float32), sigma.astype(np.float32))


@dataclass(frozen=True, eq=False)
class DistanceTable:
    """The distances of all edges, sorted by keypoint and edge.

    Attributes
    ----------
    starts
        (K + 1,) first distance of each keypoint of all images.
    edge
        (D,) int32 indices of the edges.
    log_distance, sigma
        (D,) float32, logarithm, and its standard deviation.
    edge_starts, of_edge
        First entry (E + 1,) of each edge in the indices (D,) int32 of its distances.
    """

    starts: Indices
    edge: NDArray[np.int32]
    log_distance: NDArray[np.float32]
    sigma: NDArray[np.float32]
    edge_starts: Indices
    of_edge: NDArray[np.int32]

    @classmethod
    def of(cls, distances: Sequence[EdgeDistances], keypoints: int) -> Self:
        """Return the distances of edges, given the number of keypoints of all images."""
        edge_starts, counts = np.cumsum([0, *(len(each.keypoint) for each in distances)]), np.zeros(keypoints, np.intp)
        for each in distances:
            counts[each.keypoint] += 1
        starts = np.concatenate([[0], np.cumsum(counts)])
        total, cursor = int(starts[-1]), starts[:-1].copy()
        edge, of_edge = np.empty(total, np.int32), np.empty(total, np.int32)
        log_distance, sigma = np.empty(total, np.float32), np.empty(total, np.float32)
        for i, each in enumerate(distances):
            place = cursor[each.keypoint]
            cursor[each.keypoint] += 1
            edge[place], log_distance[place], sigma[place] = i, each.log_distance, each.sigma
            of_edge[edge_starts[i] : edge_starts[i + 1]] = place
        return cls(starts, edge, log_distance, sigma, edge_starts, of_edge)

    @property
    def edges(self) -> int:
        """Number of edges."""
        return len(self.edge_starts) - 1

    def medians(self, log_scales: Array) -> Array:
        """Return the median logarithm (K,) of the distances of each keypoint, NaN if unknown.

        Edges whose scale is NaN are left out.
        """
        from omnisight.sfm._distance_kernel import fill_medians

        medians = np.empty(len(self.starts) - 1)
        fill_medians(self.starts, self.edge, self.log_distance, log_scales, medians)
        return medians


def average_log_scales(table: DistanceTable) -> tuple[Array, Array, Indices]:
    """Return the logarithms (E,) of the scales of edges, their standard deviations, and the component of each edge.

    Minimize the sum of |log d + log s_e - log D_k| / sigma over all distances d of the keypoints k, whose true
    distances D are eliminated. Edges without a common keypoint are in different components; in each, the first has the
    scale 1.
    """
    from omnisight.optim._multifrontal_kernel import add_deviations
    from omnisight.sfm._distance_kernel import fill_deviations, reweight

    edges, starts, edge = table.edges, table.starts, table.edge
    incidence = csr_array((np.ones(len(edge), bool), edge, starts), shape=(len(starts) - 1, edges))
    pattern = BlockPattern.of_incidence(np.arange(edges + 1), incidence)
    linked = coo_array((np.ones(len(pattern.row), bool), (pattern.row, pattern.column)), shape=(edges, edges))
    component = connected_components(linked, directed=False)[1]
    anchors = np.unique(component, return_index=True)[1]
    keypoint = np.repeat(np.arange(len(starts) - 1, dtype=np.int32), np.diff(starts))
    weights, right, scales = 1 / table.sigma**2, np.empty(edges), np.zeros(edges)

    def solved(scales: Array) -> Array:
        """Return the scales (E,) of least weighted squares, given those before."""
        values = np.zeros(len(pattern.row))
        add_deviations(
            values,
            pattern.row_starts,
            pattern.column,
            starts,
            edge,
            weights,
            table.edge_starts,
            table.of_edge,
            keypoint,
        )
        lower = csr_array((values, pattern.column, pattern.row_starts), shape=(edges, edges))
        # Only differences of scales are determined, so any weight of the anchors makes their scales zero.
        diagonal = np.asarray(lower.diagonal(), float)
        diagonal[anchors] += 1.0 + diagonal[anchors]
        matrix = csr_array(lower + lower.T + diags_array(diagonal - 2 * lower.diagonal()))
        inverse = 1 / diagonal
        fill_deviations(starts, edge, table.log_distance, weights, right)
        # Wrong edges link distant parts of the graph, so that a factor of the matrix is nearly dense.
        return scales + conjugate_gradients(matrix, lambda residual: inverse * residual, right - matrix @ scales)

    scales = solved(scales)
    for _ in range(ROUNDS):
        reweight(starts, edge, table.log_distance, table.sigma, scales, weights)
        scales = solved(scales)
    information = np.bincount(edge, weights, minlength=edges)
    return scales, 1 / np.sqrt(np.maximum(information, 1e-300)), component.astype(np.intp)
