"""Pose graphs: poses, or similarities, from uncertain relative ones, some of which may be wrong."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from omnisight.geometry import rotation as so3
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.loss import geman_mcclure_weights

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

# Parameters of a node: rotation vector, position, logarithm of the scale.
SIZE = 7
# Scale of the Geman-McClure loss, standard deviations: the length that residuals of 7 dimensions exceed with a
# probability of 1e-4. Edges of longer residuals are wrong.
SCALE = 5.4
# The scale of the loss relative to the largest residual at the start, and to the scale before: the loss is convex up to
# 1/sqrt(3) of its scale.
FIRST_SCALE_RATIO, SCALE_RATIO = 2.0, 0.5
# Steps at the last scale and at each scale before, and expected relative decrease of the cost at which they end.
ITERATIONS, ITERATIONS_BEFORE, TOLERANCE = 30, 4, 1e-8


@dataclass(frozen=True, eq=False)
class Similarities:
    """Frames in the world: x_world = scale * rotation @ x + position.

    Attributes
    ----------
    rotation
        (N, 3, 3).
    position
        (N, 3).
    log_scale
        (N,) logarithms of the scales: units of the world per unit of the frame.
    """

    rotation: Array
    position: Array
    log_scale: Array

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: Indices | Mask | slice) -> "Similarities":
        return Similarities(self.rotation[rows], self.position[rows], self.log_scale[rows])

    def __matmul__(self, other: "Similarities") -> "Similarities":
        """Compose: world_from_b = world_from_a @ a_from_b."""
        position = self.position + np.exp(self.log_scale)[:, None] * _apply(self.rotation, other.position)
        return Similarities(self.rotation @ other.rotation, position, self.log_scale + other.log_scale)

    def joined(self, others: "Similarities") -> "Similarities":
        """Return these frames and others."""
        names = "rotation", "position", "log_scale"
        return Similarities(*(np.concatenate([getattr(self, name), getattr(others, name)]) for name in names))

    def inverse(self) -> "Similarities":
        """Return the inverse maps."""
        transposed = np.swapaxes(self.rotation, 1, 2)
        position = -np.exp(-self.log_scale)[:, None] * _apply(transposed, self.position)
        return Similarities(transposed, position, -self.log_scale)

    def moved(self, step: Array) -> "Similarities":
        """Return the similarities moved by steps (w, v, l) (N, 7): R exp(w), position + v, log_scale + l."""
        rotation = self.rotation @ so3.exp(step[:, :3])
        return Similarities(rotation, self.position + step[:, 3:6], self.log_scale + step[:, 6])


@dataclass(frozen=True, eq=False)
class RelativeEdges:
    """Measured similarities between nodes of a graph.

    Attributes
    ----------
    a, b
        (E,) indices of the nodes.
    a_from_b
        (E) the similarities.
    root
        (E, 7, 7) whitening matrices of their steps, see `Similarities.moved`: root^T root is the information.
    may_be_wrong
        (E,) whether an edge may be wrong. All others are taken as correct.
    """

    a: Indices
    b: Indices
    a_from_b: Similarities
    root: Array
    may_be_wrong: Mask

    def __len__(self) -> int:
        return len(self.a)

    def joined(self, others: "RelativeEdges") -> "RelativeEdges":
        """Return these edges and others."""
        return RelativeEdges(
            np.append(self.a, others.a),
            np.append(self.b, others.b),
            self.a_from_b.joined(others.a_from_b),
            np.concatenate([self.root, others.root]),
            np.append(self.may_be_wrong, others.may_be_wrong),
        )


@dataclass(frozen=True, eq=False)
class PoseGraph:
    """The least-squares problem of all nodes but the first, which is fixed; a problem of `minimize`.

    The cost of edges that may be wrong is the loss of Geman and McClure, c^2 r^2 / (c^2 + r^2) / 2 of a residual of the
    length r, which is at most c^2 / 2.

    Attributes
    ----------
    edges
        The measurements.
    has_scale
        Whether the scales are known, so that they are not estimated.
    scale
        c.
    """

    edges: RelativeEdges
    has_scale: bool
    scale: float = np.inf

    def residuals(self, state: Similarities) -> Array:
        """Return the whitened residuals (E, 7)."""
        return _apply(self.edges.root, _differences(self.edges, state))

    def cost(self, state: Similarities) -> float:
        """Return half the robust sum of squares."""
        squares = (self.residuals(state) ** 2).sum(axis=1)
        robust = squares / (1 + squares / self.scale**2)
        return 0.5 * float(np.where(self.edges.may_be_wrong, robust, squares).sum())

    def weights(self, state: Similarities) -> Array:
        """Return the weights (E,) of the edges, from 0 to 1."""
        squares = (self.residuals(state) ** 2).sum(axis=1)
        return np.where(self.edges.may_be_wrong, geman_mcclure_weights(squares, self.scale**2), 1.0)

    def linearize(self, state: Similarities) -> "LinearizedGraph":
        """Return the weighted residuals and their derivatives."""
        roots = np.sqrt(self.weights(state))[:, None, None] * self.edges.root
        by_a, by_b = _derivatives(self.edges, state)
        residuals = _apply(roots, _differences(self.edges, state))
        count = len(state)
        free = np.ones((count, SIZE), np.bool_)
        free[0] = False
        free[:, 6] &= not self.has_scale
        columns = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        rows = np.arange(residuals.size).reshape(-1, SIZE)
        values, at_rows, at_columns = list[Array](), list[Indices](), list[Indices]()
        for node, derivatives in ((self.edges.a, roots @ by_a), (self.edges.b, roots @ by_b)):
            column = np.broadcast_to(columns[node][:, None, :], derivatives.shape)
            row = np.broadcast_to(rows[:, :, None], derivatives.shape)
            use = column >= 0
            values.append(derivatives[use])
            at_rows.append(row[use])
            at_columns.append(column[use])
        entries = np.concatenate(values), (np.concatenate(at_rows), np.concatenate(at_columns))
        jacobian = csc_array(entries, shape=(residuals.size, int(free.sum())))
        return LinearizedGraph(residuals.ravel(), jacobian, free)

    def move(self, state: Similarities, step: Array) -> Similarities:
        """Return the nodes moved by a step (N, 7)."""
        return state.moved(step.reshape(-1, SIZE))


@dataclass(frozen=True, eq=False)
class LinearizedGraph:
    """Weighted residuals (R,), their derivatives (R, C), and which elements (N, 7) of a step are free."""

    residuals: Array
    jacobian: csc_array
    free: Mask

    @cached_property
    def _normal(self) -> tuple[csc_array, Array]:
        return csc_array(self.jacobian.T @ self.jacobian), self.jacobian.T @ self.residuals

    def solve(self, damping: float) -> Array:
        """Return the step (7 N,); NaN if there is none."""
        information, gradient = self._normal
        damped = csc_array(information + diags_array(damping * information.diagonal()))
        step = np.zeros(self.free.shape)
        try:
            factor = splu(damped, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            step[self.free] = -factor.solve(gradient)
        except RuntimeError:  # singular
            step[self.free] = np.nan
        return step.ravel()

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step."""
        change = self.jacobian @ step.reshape(self.free.shape)[self.free]
        return -float(change @ (self.residuals + 0.5 * change))


@dataclass(frozen=True, eq=False)
class OptimizedGraph:
    """The result of a pose graph.

    Attributes
    ----------
    nodes
        The similarities world_from_node.
    is_correct
        (E,) which edges agree with them.
    residuals
        (E,) lengths of the whitened residuals.
    """

    nodes: Similarities
    is_correct: Mask
    residuals: Array


def optimize_pose_graph(edges: RelativeEdges, start: Similarities, *, has_scale: bool) -> OptimizedGraph:
    """Estimate the nodes of a graph, and which of the edges are wrong.

    Graduated non-convexity: the scale of the loss starts where it is convex, and decreases to that of the noise
    (H. Yang et al., Graduated non-convexity for robust spatial perception, RA-L 2020). The first node is fixed.

    Parameters
    ----------
    edges
        The measurements. Those that cannot be wrong must connect all nodes.
    start
        Initial nodes, such as those of odometry.
    has_scale
        Whether the scales are known.
    """
    graph = PoseGraph(edges, has_scale)
    lengths = np.linalg.norm(graph.residuals(start), axis=1)
    largest = float(lengths[edges.may_be_wrong].max(initial=0.0))
    scale, nodes = max(FIRST_SCALE_RATIO * largest, SCALE), start
    while True:
        graph = PoseGraph(edges, has_scale, scale)
        iterations = ITERATIONS if scale <= SCALE else ITERATIONS_BEFORE
        nodes = minimize(graph, nodes, iterations=iterations, tolerance=TOLERANCE).state
        if scale <= SCALE:
            break
        scale = max(scale * SCALE_RATIO, SCALE)
    lengths = np.linalg.norm(graph.residuals(nodes), axis=1)
    return OptimizedGraph(nodes, ~edges.may_be_wrong | (lengths < SCALE), lengths)


def _differences(edges: RelativeEdges, state: Similarities) -> Array:
    """Return the steps (E, 7) from the measured similarities to those of the nodes."""
    found, measured = state[edges.a].inverse() @ state[edges.b], edges.a_from_b
    turn = so3.log(np.swapaxes(measured.rotation, 1, 2) @ found.rotation)
    change = found.log_scale - measured.log_scale
    return np.concatenate([turn, found.position - measured.position, change[:, None]], axis=1)


def _derivatives(edges: RelativeEdges, state: Similarities) -> tuple[Array, Array]:
    """Return the derivatives (E, 7, 7) of the differences by steps of the nodes a and b."""
    a, b = state[edges.a], state[edges.b]
    a_from_world = np.swapaxes(a.rotation, 1, 2)
    relative = a_from_world @ b.rotation
    turn = so3.log(np.swapaxes(edges.a_from_b.rotation, 1, 2) @ relative)
    of_log = _inverse_right_jacobian(turn)
    by_a, by_b = np.zeros((2, len(edges), SIZE, SIZE))
    unit = np.exp(-a.log_scale)[:, None]
    place = unit * _apply(a_from_world, b.position - a.position)
    by_b[:, :3, :3] = of_log
    by_a[:, :3, :3] = -of_log @ np.swapaxes(relative, 1, 2)
    by_b[:, 3:6, 3:6] = unit[:, :, None] * a_from_world
    by_a[:, 3:6, 3:6] = -by_b[:, 3:6, 3:6]
    by_a[:, 3:6, :3] = so3.hat(place)
    by_a[:, 3:6, 6] = -place
    by_a[:, 6, 6], by_b[:, 6, 6] = -1.0, 1.0
    return by_a, by_b


def _inverse_right_jacobian(turn: Array) -> Array:
    """Return the derivatives (N, 3, 3) of log(exp(turn) exp(w)) by w at zero (T. Barfoot, State estimation, 7.1.5)."""
    angle = np.linalg.norm(turn, axis=1)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1 / 12 + angle**2 / 720, (1 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    skew = so3.hat(turn)
    return np.eye(3) + 0.5 * skew + factor[:, None, None] * (skew @ skew)


def _apply(matrices: Array, vectors: Array) -> Array:
    """Return the products (N, I) of matrices (N, I, J) and vectors (N, J)."""
    return np.einsum("nij,nj->ni", matrices, vectors)
