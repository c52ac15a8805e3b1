"""Rotation averaging: orientations of all frames from relative rotations of pairs with outliers."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order

from omnisight.geometry import rotation as so3
from omnisight.optim.loss import geman_mcclure_weights
from omnisight.sfm.graph_least_squares import heaviest_tree, normal_solver
from omnisight.sfm.incidence import incidence_matrix, supported_tree, triangles, unique_edges

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Rounds of reweighting with the L1 loss, which tolerates a wrong spanning tree.
L1_ROUNDS = 20
# Residuals of good edges in units of their scale, and the least scale: calibration errors bend rotations.
MAX_RESIDUAL_SIGMA, MIN_SCALE_RAD = 4.0, float(np.radians(0.02))
# Rotation of a triangle of correct edges: a random one is within it once in 100,000 times.
MAX_CYCLE_RAD = float(np.radians(3.0))
# Scales of the Geman-McClure loss: they decrease to that of the noise (graduated non-convexity; A. Blake, A. Zisserman,
# Visual reconstruction, 1987). The L1 loss leaves no larger errors.
SCALES_RAD = (*(float(np.radians(5.0)) * 0.5**k for k in range(8)), *[MIN_SCALE_RAD] * 3)


@dataclass(frozen=True, eq=False)
class RelativeRotations:
    """Relative rotations of pairs of frames.

    Attributes
    ----------
    a, b
        (E,) indices of the frames; a pair may have several edges.
    b_from_a
        (E, 3, 3).
    sigma
        (E,) standard deviations, radians.
    support
        (E,) number of matches that support the edge.
    """

    a: Indices
    b: Indices
    b_from_a: Array
    sigma: Array
    support: Array


@dataclass(frozen=True, eq=False)
class AveragedRotations:
    """Orientations of frames.

    Attributes
    ----------
    rig_from_world
        (N, 3, 3); the first frame has the orientation of the world.
    is_consistent
        (E,), whether the edge agrees with the orientations.
    """

    rig_from_world: Array
    is_consistent: NDArray[np.bool_]


def average_rotations(count: int, edges: RelativeRotations) -> AveragedRotations:
    """Estimate the orientations of N frames that the edges connect.

    Iteratively reweighted least squares on the tangent space (A. Chatterjee, V. Govindu, Robust relative rotation
    averaging, PAMI 2018), weighted by the support of the edges, from a spanning tree of those with most support: first
    with the L1 loss, then with the Geman-McClure loss of decreasing scale.
    """
    sigma, support = np.hypot(edges.sigma, MIN_SCALE_RAD), edges.support / edges.support.mean()
    rotations = _from_spanning_tree(count, edges)
    annealed = (partial(_geman_mcclure_weights, scale=scale) for scale in SCALES_RAD)
    for weights_of in (*[_l1_weights] * L1_ROUNDS, *annealed):
        residuals = _residuals(edges, rotations)
        weights = support * weights_of(np.linalg.norm(residuals, axis=1), sigma)
        rotations = rotations @ so3.exp(_solve_laplacian(count, edges, weights, residuals))
    angles = np.linalg.norm(_residuals(edges, rotations), axis=1)
    scale = _noise_scale(angles, edges.sigma)
    is_consistent = angles <= MAX_RESIDUAL_SIGMA * np.hypot(scale, edges.sigma)
    return AveragedRotations(rotations @ rotations[0].T, is_consistent)


def _from_spanning_tree(count: int, edges: RelativeRotations) -> Array:
    """Return rotations (N, 3, 3) composed along a spanning tree.

    It has as few edges as possible that no triangle confirms, and of these those with most support.
    """
    best = unique_edges(edges.a, edges.b, -edges.support)
    a, b, b_from_a = edges.a[best], edges.b[best], edges.b_from_a[best]
    tree = supported_tree(count, a, b, edges.support[best], _is_confirmed(a, b, b_from_a))
    steps = {(int(a[e]), int(b[e])): b_from_a[e] for e in tree}
    steps |= {(j, i): step.T for (i, j), step in steps.items()}
    graph = csr_array(coo_array((np.ones(len(tree)), (a[tree], b[tree])), shape=(count, count)))
    order, parents = breadth_first_order(graph, 0, directed=False)
    rotations = np.tile(np.eye(3), (count, 1, 1))
    for node in order[1:].tolist():
        parent = int(parents[node])
        rotations[node] = steps[parent, node] @ rotations[parent]
    return rotations


def _is_confirmed(a: Indices, b: Indices, b_from_a: Array) -> NDArray[np.bool_]:
    """Return which edges are in a triangle whose rotations compose to the identity.

    A wrong rotation hardly closes one (C. Zach et al., Disambiguating visual relations using loop constraints, CVPR
    2010).
    """
    rotations = np.where((a < b)[:, None, None], b_from_a, b_from_a.transpose(0, 2, 1))
    sides = triangles(a, b)
    turns = rotations[sides.ik].transpose(0, 2, 1) @ rotations[sides.jk] @ rotations[sides.ij]
    closed = np.linalg.norm(so3.log(turns), axis=1) <= MAX_CYCLE_RAD
    confirmed = np.zeros(len(a), bool)
    for side in sides:
        confirmed[side[closed]] = True
    return confirmed


def _residuals(edges: RelativeRotations, rotations: Array) -> Array:
    """Return the rotation vectors (E, 3) of R_b^T R_ba R_a, in the world frame."""
    return so3.log(rotations[edges.b].transpose(0, 2, 1) @ edges.b_from_a @ rotations[edges.a])


def _l1_weights(angles: Array, sigma: Array) -> Array:
    """Return the weights of the L1 loss."""
    return 1 / (np.maximum(angles, MIN_SCALE_RAD) * sigma)


def _geman_mcclure_weights(angles: Array, sigma: Array, scale: float) -> Array:
    """Return the weights of the Geman-McClure loss, over the variances of the edges."""
    variance = scale**2 + sigma**2
    return geman_mcclure_weights(angles**2, variance) / variance


def _noise_scale(angles: Array, sigma: Array) -> float:
    """Return the scale of the residuals beyond the stated standard deviations: that of their median."""
    # The median length of a vector of three unit Gaussians is 1.54.
    excess = np.median(np.maximum((angles / 1.54) ** 2 - sigma**2 / 3, 0.0)) if len(angles) else 0.0
    return float(max(np.sqrt(excess), MIN_SCALE_RAD))


def _solve_laplacian(count: int, edges: RelativeRotations, weights: Array, differences: Array) -> Array:
    """Return x (N, 3), x_0 = 0, that minimizes the weighted sum of |x_b - x_a - difference|^2 over the edges."""
    if count < 2:
        return np.zeros((count, 3))
    incidence = incidence_matrix(count, edges.a, edges.b)
    solve = normal_solver(incidence, weights, heaviest_tree(count, edges.a, edges.b, weights))
    return np.vstack([np.zeros((1, 3)), solve(incidence.T @ (weights[:, None] * differences))])
