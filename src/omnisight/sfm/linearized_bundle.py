"""Linearized bundle adjustment: the points are eliminated by the Schur complement."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError
from scipy.sparse import coo_array, csr_array, diags_array, hstack

from omnisight.optim.block_matrix import BlockMatrix, BlockPattern
from omnisight.optim.conjugate_gradients import conjugate_gradients
from omnisight.optim.multifrontal import Front, MultifrontalFactor, fronts_of
from omnisight.parallel import parallel_for

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Points per task of a thread, and most tasks of one that has a matrix of the cameras.
POINTS_PER_TASK, MAX_MATRICES = 2048, 8
# Columns of the cameras up to which their variances are exact, which takes one solution for each. Beyond, they are
# means over PROBES random combinations of the gradients, with a relative standard deviation of sqrt(2 / PROBES).
MAX_EXACT_COLUMNS, PROBES, PROBES_AT_ONCE = 3000, 512, 32
# Share of derivatives that are not zero beyond which dense matrices are faster.
MIN_DENSE_SHARE = 0.1
# Leverage beyond which the residuals of a point are those of unfinished iterations.
MAX_LEVERAGE = 0.999
# Least damping of the preconditioner: with points divided between few cameras it can be singular.
PRECONDITIONER_DAMPING = 1e-8


class Prior(NamedTuple):
    """Whitened residuals (R,) that depend on cameras only, and their derivatives (R, C), sparse or dense."""

    residuals: Array
    derivatives: csr_array | Array

    @classmethod
    def of(cls, residuals: Array, columns: Indices, derivatives: Array, count: int) -> "Prior":
        """Return the prior of residuals (R,) with derivatives (R, K) by some of the columns, -1 if they are fixed."""
        if derivatives.size >= MIN_DENSE_SHARE * len(residuals) * count:
            # The last column is that of fixed parameters.
            dense = np.zeros((len(residuals), count + 1))
            dense[np.arange(len(residuals))[:, None], columns] = derivatives
            return cls(residuals, dense[:, :count])
        free = columns >= 0
        starts = np.concatenate([[0], np.cumsum(free.sum(axis=1))])
        return cls(residuals, csr_array((derivatives[free], columns[free], starts), (len(residuals), count)))

    def add_information(self, matrix: BlockMatrix, diagonal: Array) -> None:
        """Add the information of the cameras to a matrix (C, C) and to its undamped diagonal (C,), in place."""
        product = self.derivatives.T @ self.derivatives
        if isinstance(product, np.ndarray) and len(matrix.values) == product.size:  # the pattern is one block
            matrix.values[:] += product.ravel()
            diagonal += product.diagonal()
            return
        product = coo_array(product)
        lower = product.row >= product.col
        row, column = (index[lower].astype(np.intp) for index in (product.row, product.col))
        values = np.asarray(product.data[lower], float)
        matrix.values[matrix.pattern.addresses(row, column)] += values
        diagonal[row[row == column]] += values[row == column]


@dataclass(frozen=True, eq=False)
class CameraColumns:
    """Where the derivatives of observations by cameras are in the normal equations.

    Attributes
    ----------
    columns
        (M, L) int32, column of each derivative; -1 if it is fixed.
    groups
        (M, K) int32, group of the columns of each part of the derivatives: a frame, a sensor, or the free values; -1 if
        all are fixed.
    parts
        (K + 1,) first derivative of each part.
    pattern
        The groups that common points, or a prior, connect.
    """

    columns: NDArray[np.int32]
    groups: NDArray[np.int32]
    parts: Indices
    pattern: BlockPattern

    @cached_property
    def fronts(self) -> list[Front]:
        """The fronts of the elimination of the cameras."""
        return fronts_of(self.pattern)

    @property
    def layout(self) -> tuple[Indices, Indices, Indices, Indices]:
        """How the blocks are stored, for compiled loops."""
        return self.pattern.starts, self.pattern.row_starts, self.pattern.column, self.pattern.offsets


class DividedPoints(NamedTuple):
    """Observations of points that are divided between distant frames: fewer frames are connected.

    Attributes
    ----------
    observation
        (K,) indices of the observations, sorted by part of a point. Parts with one observation are left out.
    starts
        (Q + 1,) first observation of each part.
    point
        (K,) indices of the parts.
    cameras
        Columns of the derivatives of these observations by cameras.
    """

    observation: Indices
    starts: Indices
    point: Indices
    cameras: CameraColumns


class ReducedSystem(NamedTuple):
    """The normal equations of the cameras without the points: matrix, right side (C,), and undamped diagonal (C,)."""

    matrix: BlockMatrix
    right: Array
    diagonal: Array


@dataclass(frozen=True, eq=False)
class LinearizedBundle:
    """Weighted residuals and their derivatives.

    Attributes
    ----------
    starts
        (P + 1,) first observation of each point.
    point
        (M,) indices of the points.
    cameras
        Columns of the derivatives by cameras.
    residuals, by_camera, by_point
        (M, 2), (M, 2, L) and (M, 2, 3).
    prior
        What is known of the cameras besides the observations.
    divided
        The points of the preconditioner; None if the normal equations of the cameras are factored.
    """

    starts: Indices
    point: Indices
    cameras: CameraColumns
    residuals: Array
    by_camera: Array
    by_point: Array
    prior: Prior
    divided: DividedPoints | None = None

    @property
    def count(self) -> int:
        """Number of columns C of the cameras."""
        return self.cameras.pattern.size

    @property
    def _jacobian(self) -> tuple[Array, Array, Array]:
        return self.residuals, self.by_camera, self.by_point

    def solve(self, damping: float) -> Array:
        """Return the step (C + 3 P,): cameras, then points; NaN if there is none."""
        from omnisight.sfm._bundle_kernel import solve_points

        moves = np.full((len(self.starts) - 1, 3), np.nan)
        try:
            step = self._camera_step(damping)
        except LinAlgError:
            return np.full(self.count + moves.size, np.nan)
        columns = self.cameras.columns
        parallel_for(
            lambda first, last: solve_points(self.starts, columns, *self._jacobian, damping, first, last, step, moves),
            len(moves),
            POINTS_PER_TASK,
        )
        return np.concatenate([step, moves.ravel()])

    def _camera_step(self, damping: float) -> Array:
        """Return the step (C,) of the cameras.

        Many cameras are not factored. The preconditioner is the factor of the same problem with divided points, which
        has less information in few directions: preconditioners of strongly connected cameras are those of A. Kushal
        and S. Agarwal, Visibility based preconditioning for bundle adjustment, 2012, but a matrix whose weak blocks
        are dropped need not be positive definite.
        """
        matrix, right, diagonal = self.reduced(damping)
        matrix.add_diagonal(damping * diagonal)
        if self.divided is None:
            return -self.factor(matrix).solve(right)
        near = self._with_divided_points(self.divided)
        approximate = near.reduced(damping).matrix
        approximate.add_diagonal(max(damping, PRECONDITIONER_DAMPING) * diagonal)
        return -conjugate_gradients(matrix, near.factor(approximate).solve, right)

    def _with_divided_points(self, divided: DividedPoints) -> "LinearizedBundle":
        use = divided.observation
        return LinearizedBundle(
            divided.starts,
            divided.point,
            divided.cameras,
            self.residuals[use],
            self.by_camera[use],
            self.by_point[use],
            self.prior,
        )

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step."""
        from omnisight.sfm._bundle_kernel import linear_decrease

        cameras, moves = step[: self.count], step[self.count :].reshape(-1, 3)
        change = self.prior.derivatives @ cameras
        of_prior = float(change @ (self.prior.residuals + 0.5 * change))
        return float(linear_decrease(self.cameras.columns, self.point, *self._jacobian, cameras, moves)) - of_prior

    def factor(self, matrix: BlockMatrix) -> MultifrontalFactor:
        """Return the factor of a matrix of the cameras; raise LinAlgError if it is not positive definite."""
        return MultifrontalFactor.of(matrix, self.cameras.fronts)

    def reduced(self, damping: float = 0.0) -> ReducedSystem:
        """Return the normal equations of the cameras, from which the points are eliminated."""
        from omnisight.sfm._bundle_kernel import reduce_points

        cameras, parts = self.cameras, dict[int, ReducedSystem]()
        indices = self.starts, cameras.columns, cameras.groups, cameras.parts
        terms = int(np.diff(self.starts).max(initial=0)), 3, cameras.columns.shape[1]

        def work(first: int, last: int) -> None:
            part = ReducedSystem(cameras.pattern.zeros(), np.zeros(self.count), np.zeros(self.count))
            into = cameras.layout, part.matrix.values, part.right, part.diagonal
            memory = np.empty((3, 3)), np.empty(3), np.empty(terms), np.empty(terms)
            reduce_points(*indices, *self._jacobian, damping, first, last, *into, *memory)
            parts[first] = part

        points = len(self.starts) - 1
        parallel_for(work, points, max(POINTS_PER_TASK, -(-points // MAX_MATRICES)))
        # In the order of the points, whatever thread was first: sums are rounded in the same way in every run.
        (matrix, right, diagonal), *others = (parts[first] for first in sorted(parts))
        for part in others:
            for target, values in ((matrix.values, part.matrix.values), (right, part.right), (diagonal, part.diagonal)):
                target += values
        self.prior.add_information(matrix, diagonal)
        right += self.prior.derivatives.T @ self.prior.residuals
        return ReducedSystem(matrix, right, diagonal)

    def gradients(self) -> csr_array:
        """Return the gradients (C, P + R) of the cost of each point, and of the prior, by the cameras.

        Their outer products estimate the covariance of the gradient of the cost at the optimum whatever the
        distribution of the residuals and their correlation in the images of a point.
        """
        columns = self.cameras.columns
        gradients = np.einsum("mkl,mk->ml", self.by_camera, self.residuals)
        point, free = np.broadcast_to(self.point[:, None], columns.shape), columns >= 0
        shape = self.count, len(self.starts) - 1
        of_points = coo_array((gradients[free], (columns[free], point[free])), shape=shape)
        return csr_array(hstack([of_points, csr_array(self.prior.derivatives.T)]))

    def covariances(self, gradients: csr_array | None = None, noise: float = 1.0) -> tuple[BlockMatrix, Array]:
        """Return the covariances of the cameras, of the groups that points connect, and of the points (P, 3, 3).

        Parameters
        ----------
        gradients
            (C, P + R) gradients of the points and of the prior, for robust variances; by default the inverse of the
            information.
        noise
            Variance of the residuals: the factor of the part of the points' own observations.

        Raises
        ------
        LinAlgError
            If the observations do not determine the cameras.
        """
        factor = self.factor(self.reduced().matrix)
        inverse = factor.inverse()
        if gradients is not None:
            unbiased = gradients @ diags_array(1 / np.sqrt(1 - self._leverages(inverse)))
            # Only the variances, because the correlations of few points are inaccurate.
            inverse = inverse.scaled(np.sqrt(_sandwich_variances(factor, csr_array(unbiased)) / inverse.diagonal()))
        return inverse, self._point_covariances(inverse, noise)

    def _point_covariances(self, cameras: BlockMatrix, noise: float) -> Array:
        """Return the covariances (P, 3, 3) of the points for those of the cameras, and a variance of the residuals."""
        from omnisight.sfm._bundle_kernel import point_covariances

        covariances = np.empty((len(self.starts) - 1, 3, 3))
        self._fill_points(point_covariances, cameras, noise, covariances)
        return covariances

    def _leverages(self, cameras: BlockMatrix) -> Array:
        """Return the leverages (P + R,) of the points, and zeros for the prior, given the covariances of the cameras.

        A point whose leverage is h has residuals with 1 - h of the variance of its errors, because the cameras are
        fitted to it; where few points connect cameras, robust variances without this correction are too small (J.
        MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with improved finite sample
        properties, 1985).
        """
        from omnisight.sfm._leverage_kernel import point_leverages

        moved = self._point_covariances(cameras, 0.0)
        leverages = np.zeros(len(moved) + len(self.prior.residuals))
        self._fill_points(point_leverages, cameras, moved, leverages)
        return np.clip(leverages, 0.0, MAX_LEVERAGE)

    def _fill_points(
        self, kernel: Callable[..., None], cameras: BlockMatrix, argument: Array | float, values: Array
    ) -> None:
        """Fill values (P, ...) of the points by a compiled function of the covariances of the cameras."""
        indices = self.starts, self.cameras.columns, self.cameras.groups, self.cameras.parts
        arguments = *indices, *self._jacobian, self.cameras.layout, cameras.values, argument
        parallel_for(lambda first, last: kernel(*arguments, first, last, values), len(self.starts) - 1, POINTS_PER_TASK)


def _sandwich_variances(factor: MultifrontalFactor, gradients: csr_array) -> Array:
    """Return the diagonal (C,) of A^-1 G G^T A^-1 for gradients G (C, N).

    It is that of A^-1 for parameters that the observations hardly determine, whose gradients are those of rounding.
    """
    if (count := factor.pattern.size) <= MAX_EXACT_COLUMNS:
        inverse, squares = factor.solve(np.eye(count)), gradients @ gradients.T
        variances, rounding = (((m @ x) * x).sum(axis=0) for m, x in ((squares, inverse), (abs(squares), abs(inverse))))
        return np.where(variances > np.finfo(float).eps * rounding, variances, inverse.diagonal())
    by_part, rng, squares = gradients.tocsc(), np.random.default_rng(0), np.zeros(count)
    for _ in range(PROBES // PROBES_AT_ONCE):
        signs = rng.choice((-1.0, 1.0), (len(by_part.indptr) - 1, PROBES_AT_ONCE))
        squares += (factor.solve(by_part @ signs) ** 2).sum(axis=1)
    return squares / PROBES
