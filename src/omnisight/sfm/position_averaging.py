"""Positions of cameras with known orientations from the directions and the relative scales of pairs of images."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack, kron

from omnisight.optim.loss import geman_mcclure_weights
from omnisight.sfm.graph_least_squares import heaviest_tree, normal_solver
from omnisight.sfm.incidence import incidence_matrix, supported_tree, triangles, unique_edges
from omnisight.sfm.scale_averaging import ROUNDS

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Scales of the Geman-McClure loss of positions in standard deviations (graduated non-convexity; A. Blake, A. Zisserman,
# Visual reconstruction, 1987), and weight of the edges outside the spanning tree at the start.
SCALES, OUTSIDE_TREE = (*(100.0 * 0.5**k for k in range(5)), *[5.0] * 3), 1e-6
# Gap of a triangle of correct displacements, relative to its longest side.
MAX_TRIANGLE_GAP = 0.1
# Information of the prior that the unit of a rig is zero, relative to that of all displacements for known positions:
# above rounding errors, so that the equations can be solved if nothing determines the unit, and far below OUTSIDE_TREE.
UNIT_PRIOR = 1e-13
# Noise of a direction besides that of the relative pose, radians.
MIN_DIRECTION_SIGMA = 1e-3


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
    prior = np.zeros(matrix.shape[1])
    if has_arms:
        prior[-1] = UNIT_PRIOR * float((matrix[:, [-1]] ** 2).sum())

    def solver(weights: Array) -> Callable[[Array], Array]:
        in_tree = heaviest_tree(count, edges.a, edges.b, weights)
        return normal_solver(matrix, np.repeat(weights, 3), np.repeat(in_tree, 3), prior)

    def solve(weights: Array) -> tuple[Array, Array]:
        """Return the solution and the lengths (E,) of the residuals."""
        solution = solver(weights)(matrix.T @ (np.repeat(weights, 3) * right))
        return solution, np.linalg.norm((matrix @ solution - right).reshape(-1, 3), axis=1)

    weights = support = edges.support / edges.support.mean()
    # The edges outside the tree determine the unit of the rig, so wrong ones must not count.
    outside = _reweighted(solve, support) if has_arms else support
    solution, residuals = solve(np.where(_spanning_tree_edges(count, edges), support, OUTSIDE_TREE * outside))
    for scale in SCALES:
        weights = support * geman_mcclure_weights(residuals**2, scale**2)
        solution, residuals = solve(weights)
    positions = np.vstack([np.zeros((1, 3)), solution[: 3 * (count - 1)].reshape(-1, 3)])
    if not has_arms:
        return AveragedPositions(positions, 1.0)
    last = np.append(np.zeros(matrix.shape[1] - 1), 1.0)
    sigma = float(np.sqrt(solver(weights)(last)[-1]))
    unit = max(float(solution[-1]), sigma)
    return AveragedPositions(positions / unit, unit)


def _spanning_tree_edges(count: int, edges: RelativePositions) -> NDArray[np.bool_]:
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


def _reweighted(solve: Callable[[Array], tuple[Array, Array]], weights: Array) -> Array:
    """Return the weights that minimize the sum of weighted lengths of residuals, beyond one standard deviation."""
    used = weights
    for _ in range(ROUNDS):
        used = weights / np.maximum(solve(used)[1], 1.0)
    return used
