"""Positions of cameras with known orientations from the directions and the relative scales of pairs of images.

The distance of a point from a camera is known up to the scale of each pair that triangulates it. Pairs that share a
camera and keypoints thus have known relative scales, also along a straight path, where directions alone do not
determine positions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array, hstack, kron
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.optim.block_matrix import BlockPattern
from omnisight.optim.multifrontal import MultifrontalFactor, fronts_of
from omnisight.parallel import parallel_map
from omnisight.sfm.incidence import incidence_matrix, supported_tree, triangles, unique_edges
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.triangulation import triangulate

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Rounds of reweighting: the least sum of lengths (L1) is close after ten.
ROUNDS = 15
# Scales of the Geman-McClure loss of positions in standard deviations (graduated non-convexity; A. Blake, A. Zisserman,
# Visual reconstruction, 1987), and weight of the edges outside the spanning tree at the start.
SCALES, OUTSIDE_TREE = (*(100.0 * 0.5**k for k in range(5)), *[5.0] * 3), 1e-6
# Gap of a triangle of correct displacements, relative to its longest side.
MAX_TRIANGLE_GAP = 0.1
# Standard deviation of the logarithm of a distance above which it is not Gaussian, and its mean is wrong.
MAX_LOG_SIGMA = 0.3
# Noise of a logarithm of a scale or distance besides that of triangulation, and of a direction, radians.
MIN_LOG_SIGMA, MIN_DIRECTION_SIGMA = 0.02, 1e-3


@dataclass(frozen=True, eq=False)
class EdgeDistances:
    """Distances of the points that an edge triangulates with a baseline of length 1.

    Attributes
    ----------
    camera, keypoint
        (D,) indices of the camera from which the distance is, and of its keypoint.
    log_distance, sigma
        (D,) logarithm, and its standard deviation.
    """

    camera: Indices
    keypoint: Indices
    log_distance: Array
    sigma: Array


class PointDistances:
    """Distances of the points of edges. Each edge is triangulated once.

    Attributes
    ----------
    keypoints
        Keypoints of all images.
    """

    def __init__(self, keypoints: Sequence[Keypoints]) -> None:
        self.keypoints = keypoints
        self._known: dict[Edge, EdgeDistances] = {}

    def of(self, edges: Sequence[Edge]) -> list[EdgeDistances]:
        """Return the distances of the points of each edge."""
        new = [edge for edge in edges if edge not in self._known]
        self._known |= zip(new, parallel_map(lambda edge: edge_distances(edge, self.keypoints), new), strict=True)
        return [self._known[edge] for edge in edges]


def edge_distances(edge: Edge, keypoints: Sequence[Keypoints]) -> EdgeDistances:
    """Triangulate the inliers of an edge, and return the well-known distances from both cameras."""
    ends = (keypoints[edge.a], edge.pairs[:, 0]), (keypoints[edge.b], edge.pairs[:, 1])
    poses = [Pose(), edge.b_from_a]
    bearings, covariance = (np.stack([getattr(k, name)[i] for k, i in ends]) for name in ("bearings", "covariance"))
    found = triangulate(poses, bearings, covariance)
    use = np.flatnonzero(found.valid)
    parts: list[tuple[Indices, Indices, Array, Array]] = []
    for side, (image, pose) in enumerate(zip((edge.a, edge.b), poses, strict=True)):
        points = pose @ found.points[use]
        distance = np.linalg.norm(points, axis=1)
        along = (points / distance[:, None]) @ pose.rotation
        variance = np.einsum("ni,nij,nj->n", along, found.covariance[use], along)
        sigma = np.sqrt(np.maximum(variance, 0.0)) / distance
        known = sigma <= MAX_LOG_SIGMA
        keypoint, sigma = edge.pairs[use[known], side], np.hypot(sigma[known], MIN_LOG_SIGMA)
        parts.append((np.full(len(keypoint), image, np.intp), keypoint, np.log(distance[known]), sigma))
    return EdgeDistances(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def average_log_scales(distances: Sequence[EdgeDistances]) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return the logarithms (E,) of the scales of edges, their standard deviations, and the component of each edge.

    Minimize the sum of |log d + log s_e - log D_k| / sigma over all distances d of the keypoints k, whose true
    distances D are eliminated. Edges without a common keypoint are in different components; in each, the first has the
    scale 1.
    """
    from omnisight.optim._multifrontal_kernel import add_deviations

    edge = np.repeat(np.arange(len(distances)), [len(d.camera) for d in distances])
    camera, keypoint, values, sigma = (
        np.concatenate([getattr(d, name) for d in distances])
        for name in ("camera", "keypoint", "log_distance", "sigma")
    )
    _, node = np.unique(camera * (keypoint.max(initial=0) + 1) + keypoint, return_inverse=True)
    order, edges = np.argsort(node, kind="stable"), len(distances)
    edge, node, values, sigma = edge[order], node[order], values[order], sigma[order]
    starts = np.searchsorted(node, np.arange(int(node.max(initial=-1)) + 2))
    incidence = csr_array((np.ones(len(edge), bool), edge, starts), shape=(len(starts) - 1, edges))
    pattern = BlockPattern.of_incidence(np.arange(edges + 1), incidence)
    linked = coo_array((np.ones(len(pattern.row), bool), (pattern.row, pattern.column)), shape=(edges, edges))
    component = connected_components(linked, directed=False)[1]
    anchors, fronts = np.unique(component, return_index=True)[1], fronts_of(pattern)
    by_edge = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=edges))]), np.argsort(edge, kind="stable")

    def mean(weights: Array, quantity: Array) -> Array:
        """Return the weighted mean of a quantity (D,) of the distances of the same keypoint."""
        total = np.add.reduceat(weights, starts[:-1])
        return (np.add.reduceat(weights * quantity, starts[:-1]) / total)[node]

    def solve(weights: Array) -> tuple[Array, Array]:
        """Return scales (E,) and residuals (D,)."""
        matrix, fixing = pattern.zeros(), np.zeros(edges)
        add_deviations(matrix.values, pattern.row_starts, pattern.column, starts, edge, weights, *by_edge, node)
        # Only differences of scales are determined, so that any weight of the anchors makes their scales zero.
        fixing[anchors] = 1.0 + np.bincount(edge, weights, minlength=edges)[anchors]
        matrix.add_diagonal(fixing)
        right = np.asarray(np.bincount(edge, weights * (mean(weights, values) - values), minlength=edges), float)
        scales = MultifrontalFactor.of(matrix, fronts).solve(right)
        shifted = values + scales[edge]
        return scales, shifted - mean(weights, shifted)

    scales, _, weights = _reweighted(solve, 1 / sigma**2, sigma)
    information = np.bincount(edge, weights, minlength=edges)
    return scales, 1 / np.sqrt(np.maximum(information, 1e-300)), component.astype(np.intp)


@dataclass(frozen=True, eq=False)
class RelativePositions:
    """Displacements between pairs of images.

    Attributes
    ----------
    a, b
        (E,) indices of the frames of the images.
    displacement
        (E, 3) from image a to image b in the world frame, in a unit of its own.
    arm
        (E, 3) part of it that is due to the places of the sensors in the rig, in the unit of the rig.
    lengthwise, crosswise
        (E,) standard deviations along and across the displacement.
    support
        (E,) number of matches that support the edge: those that are wrong if it is.
    """

    a: Indices
    b: Indices
    displacement: Array
    arm: Array
    lengthwise: Array
    crosswise: Array
    support: Array


class AveragedPositions(NamedTuple):
    """Positions of frames.

    Attributes
    ----------
    positions
        (N, 3); the first is zero.
    unit
        Unit of the positions in the unit of the displacements: that of the rig if there are arms, otherwise 1.
    """

    positions: Array
    unit: float


def average_positions(count: int, edges: RelativePositions) -> AveragedPositions:
    """Estimate the positions of N frames that the edges connect.

    Minimize the Geman-McClure loss of the residuals in standard deviations, weighted by the support of the edges: an
    edge far from its place has as many wrong matches as it has matches. Graduated non-convexity starts from a spanning
    tree of the edges with most support. With arms, their length in the unit of the displacements is estimated too.
    """
    along = edges.displacement / np.maximum(np.linalg.norm(edges.displacement, axis=1), 1e-300)[:, None]
    outer = along[:, :, None] * along[:, None, :]
    lengthwise, crosswise = edges.lengthwise[:, None, None], edges.crosswise[:, None, None]
    information = outer / lengthwise**2 + (np.eye(3) - outer) / crosswise**2
    half = np.linalg.cholesky(information).transpose(0, 2, 1)
    # Each edge has three rows, half (c_b - c_a + unit arm - displacement), of a matrix with three columns for each
    # frame and the last one for the unit of the rig.
    matrix: Any = csr_array(
        _block_diagonal(half) @ csr_array(kron(incidence_matrix(count, edges.a, edges.b), np.eye(3)))
    )
    has_arms = bool(edges.arm.any())
    if has_arms:
        matrix = hstack([matrix, csr_array(np.einsum("erc,ec->er", half, edges.arm).reshape(-1, 1))]).tocsr()
    right = np.einsum("erc,ec->er", half, edges.displacement).ravel()

    def solve(weights: Array) -> tuple[Array, Array]:
        """Return the solution and the lengths (E,) of the residuals."""
        weighted = diags_array(np.repeat(weights, 3)) @ matrix
        solution = np.asarray(spsolve((matrix.T @ weighted).tocsc(), weighted.T @ right), float)
        return solution, np.linalg.norm((matrix @ solution - right).reshape(-1, 3), axis=1)

    weights = support = edges.support / edges.support.mean()
    # The edges outside the tree determine the unit of the rig, so that wrong ones must not count.
    outside = _reweighted(solve, support, np.ones(len(along)))[2] if has_arms else support
    solution, residuals = solve(np.where(_in_tree(count, edges), support, OUTSIDE_TREE * outside))
    for scale in SCALES:
        weights = support * (scale**2 / (scale**2 + residuals**2)) ** 2
        solution, residuals = solve(weights)
    positions = np.vstack([np.zeros((1, 3)), solution[: 3 * (count - 1)].reshape(-1, 3)])
    if not has_arms:
        return AveragedPositions(positions, 1.0)
    normal = matrix.T @ diags_array(np.repeat(weights, 3)) @ matrix
    last = np.append(np.zeros(matrix.shape[1] - 1), 1.0)
    sigma = float(np.sqrt(np.asarray(spsolve(normal.tocsc(), last), float)[-1]))
    unit = max(float(solution[-1]), sigma)
    return AveragedPositions(positions / unit, unit)


def _in_tree(count: int, edges: RelativePositions) -> NDArray[np.bool_]:
    """Return which edges are in the spanning tree of the edges with most support.

    It has as few edges as possible that no triangle confirms.
    """
    moving = np.flatnonzero(edges.a != edges.b)
    best = moving[unique_edges(edges.a[moving], edges.b[moving], -edges.support[moving])]
    a, b = edges.a[best], edges.b[best]
    step = np.where(a < b, 1.0, -1.0)[:, None] * edges.displacement[best]
    sides, confirmed = triangles(a, b), np.zeros(len(best), bool)
    gap = np.linalg.norm(step[sides.ij] + step[sides.jk] - step[sides.ik], axis=1)
    longest = np.max([np.linalg.norm(step[side], axis=1) for side in sides], axis=0)
    for side in sides:
        confirmed[side[gap <= MAX_TRIANGLE_GAP * longest]] = True
    found = np.zeros(len(edges.a), bool)
    found[best[supported_tree(count, a, b, edges.support[best], confirmed)]] = True
    return found


def _block_diagonal(blocks: Array) -> csr_array:
    """Return the sparse matrix (3 E, 3 E) with blocks (E, 3, 3) on its diagonal."""
    count = len(blocks)
    indices = 3 * np.repeat(np.arange(count), 9).reshape(count, 3, 3) + np.arange(3)
    return csr_array((blocks.ravel(), indices.ravel(), np.arange(0, 9 * count + 1, 3)), shape=(3 * count, 3 * count))


def _reweighted(
    solve: Callable[[Array], tuple[Array, Array]], weights: Array, sigma: Array
) -> tuple[Array, Array, Array]:
    """Minimize the sum of lengths of residuals over their standard deviations; return solution, residuals, weights."""
    solution, residuals = solve(weights)
    used = weights
    for _ in range(ROUNDS):
        used = weights / np.maximum(np.abs(residuals) / sigma, 1.0)
        solution, residuals = solve(used)
    return solution, residuals, used
