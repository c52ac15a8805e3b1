"""Linearized bundle adjustment: the points are eliminated by the Schur complement."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_solve
from scipy.sparse import coo_array, csr_array

from omnisight.optim.cholesky import factor_cholesky
from omnisight.parallel import parallel_for

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Points per task of a thread.
POINTS_PER_TASK = 2048


class Prior(NamedTuple):
    """Whitened residuals (R,) that depend on cameras only, and their derivatives (R, C)."""

    residuals: Array
    derivatives: csr_array


@dataclass(frozen=True, eq=False)
class LinearizedBundle:
    """Weighted residuals and their derivatives.

    Attributes
    ----------
    starts
        (P + 1,) first observation of each point.
    point
        (M,) indices of the points.
    columns
        (M, L) int32, column of each derivative by a camera; -1 if it is fixed.
    count
        Number of columns C.
    residuals, by_camera, by_point
        (M, 2), (M, 2, L) and (M, 2, 3).
    prior
        What is known of the cameras besides the observations.
    """

    starts: Indices
    point: Indices
    columns: NDArray[np.int32]
    count: int
    residuals: Array
    by_camera: Array
    by_point: Array
    prior: Prior

    @property
    def _jacobian(self) -> tuple[NDArray[np.int32], Array, Array, Array]:
        return self.columns, self.residuals, self.by_camera, self.by_point

    def solve(self, damping: float) -> Array:
        """Return the step (C + 3 P,): cameras, then points; NaN if there is none."""
        from omnisight.sfm._bundle_kernel import solve_points

        moves = np.full((len(self.starts) - 1, 3), np.nan)
        try:
            schur, right, diagonal = self.reduced(damping)
            schur[np.diag_indices(self.count)] += damping * diagonal
            step = -cho_solve(factor_cholesky(schur), right)
        except LinAlgError:
            return np.full(self.count + moves.size, np.nan)
        parallel_for(
            lambda first, last: solve_points(self.starts, *self._jacobian, damping, first, last, step, moves),
            len(moves),
            POINTS_PER_TASK,
        )
        return np.concatenate([step, moves.ravel()])

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step."""
        from omnisight.sfm._bundle_kernel import linear_decrease

        jacobian = self.residuals, self.by_camera, self.by_point
        cameras, moves = step[: self.count], step[self.count :].reshape(-1, 3)
        change = self.prior.derivatives @ cameras
        of_prior = float(change @ (self.prior.residuals + 0.5 * change))
        return float(linear_decrease(self.columns, self.point, *jacobian, cameras, moves)) - of_prior

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array, Array]:
        """Return the Schur complement (C, C; lower triangle only), right side and diagonal."""
        from omnisight.sfm._bundle_kernel import reduce_points

        parts: list[tuple[Array, Array, Array]] = []

        def work(first: int, last: int) -> None:
            part = np.zeros((self.count, self.count)), np.zeros(self.count), np.zeros(self.count)
            reduce_points(self.starts, *self._jacobian, damping, first, last, *part)
            parts.append(part)

        parallel_for(work, len(self.starts) - 1, POINTS_PER_TASK)
        total = parts.pop()
        for part in parts:
            for target, values in zip(total, part, strict=True):
                target += values
        schur, right, diagonal = total
        residuals, derivatives = self.prior
        of_prior = (derivatives.T @ derivatives).tocoo()
        schur[of_prior.row, of_prior.col] += of_prior.data
        diagonal += of_prior.diagonal()
        right += derivatives.T @ residuals
        return total

    def score_scatter(self) -> Array:
        """Return the sum of outer products of the gradients of all points by the cameras (C, C), and of the prior.

        It estimates the covariance of the gradient of the cost at the optimum whatever the distribution of the
        residuals and their correlation in the images of a point.
        """
        gradients = np.einsum("mkl,mk->ml", self.by_camera, self.residuals)
        row, free = np.broadcast_to(self.point[:, None], self.columns.shape), self.columns >= 0
        shape = len(self.starts) - 1, self.count
        of_points = coo_array((gradients[free], (row[free], self.columns[free])), shape=shape).tocsr()
        derivatives = self.prior.derivatives
        return np.asarray((of_points.T @ of_points + derivatives.T @ derivatives).toarray(), float)

    def covariances(self, scatter: Array | None = None, noise: float = 1.0) -> tuple[Array, Array]:
        """Return the covariances of the cameras (C, C), and of the points (P, 3, 3).

        Parameters
        ----------
        scatter
            (C, C) covariance of the gradient by the cameras, for their variances; by default the information.
        noise
            Variance of the residuals, by which the part of the points' own observations is multiplied.

        Raises
        ------
        LinAlgError
            If the observations do not determine the cameras.
        """
        from omnisight.sfm._bundle_kernel import point_covariances

        schur, _, _ = self.reduced()
        cameras = np.asarray(cho_solve(factor_cholesky(schur), np.eye(self.count)), float)
        if scatter is not None:
            # Only the variances, because the correlations of few points are inaccurate.
            variances = np.einsum("ij,jk,ki->i", cameras, scatter, cameras, optimize=True)
            ratio = np.sqrt(variances / np.diag(cameras))
            cameras *= ratio[:, None] * ratio
        points = np.empty((len(self.starts) - 1, 3, 3))
        parallel_for(
            lambda first, last: point_covariances(self.starts, *self._jacobian, cameras, noise, first, last, points),
            len(points),
            POINTS_PER_TASK,
        )
        return cameras, points
