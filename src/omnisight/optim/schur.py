"""Normal equations of shared parameters and many independent groups of local ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Eigenvalues of normal equations with unit diagonal below this are rounding errors.
MIN_EIGENVALUE = 1e-14


@dataclass(frozen=True)
class GroupedNormal:
    """H x = -g with H = [A B; B^T C], C block diagonal: one block per group.

    The shared parameters (a camera) couple the groups (boards), which are otherwise independent. With the Schur
    complement of C the cost of a solution is linear in the number of groups (Triggs et al., Bundle adjustment: a
    modern synthesis, 2000, sec. 6).

    Attributes
    ----------
    shared
        A (P, P).
    cross
        B (G, P, L), by group.
    local
        C (G, L, L).
    shared_gradient, local_gradient
        g: (P,) and (G, L).
    """

    shared: Array
    cross: Array
    local: Array
    shared_gradient: Array
    local_gradient: Array

    @classmethod
    def assemble(cls, d_shared: Array, d_local: Array, residuals: Array, groups: Sequence[slice]) -> Self:
        """Assemble residuals (N, R) with Jacobians (N, R, P) and (N, R, L); each group has one slice of rows."""
        count, size = d_shared.shape[-1], d_local.shape[-1]
        rows = np.concatenate([d_shared, d_local, residuals[..., None]], -1)
        stacked = rows.reshape(-1, rows.shape[-1])
        total = stacked[:, :count].T @ stacked
        # One product (P + L, L + 1) per row, summed over the rows of a group: faster than a loop over small matrices.
        products = np.swapaxes(rows[..., :-1], -1, -2) @ rows[..., count:]
        none = np.zeros((0, count + size, size + 1))
        summed = np.stack([products[group].sum(0) for group in groups]) if groups else none
        return cls(
            total[:, :count], summed[:, :count, :-1], summed[:, count:, :-1], total[:, -1], summed[:, count:, -1]
        )

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the normal equations of all groups of several parts, in order."""
        return cls(
            np.sum([part.shared for part in parts], axis=0),
            np.concatenate([part.cross for part in parts]),
            np.concatenate([part.local for part in parts]),
            np.sum([part.shared_gradient for part in parts], axis=0),
            np.concatenate([part.local_gradient for part in parts]),
        )

    def along(self, directions: Array) -> Self:
        """Return the normal equations for shared parameters restricted to `directions` (P, F)."""
        return replace(
            self,
            shared=directions.T @ self.shared @ directions,
            cross=directions.T @ self.cross,
            shared_gradient=directions.T @ self.shared_gradient,
        )

    def with_prior(self, information: Array, gradient: Array) -> Self:
        """Return the normal equations with a prior on the shared parameters: its H (P, P) and g (P,)."""
        return replace(self, shared=self.shared + information, shared_gradient=self.shared_gradient + gradient)

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Return the damped Schur complement (P, P), its right side (P,), C^-1 (G, L, L) and B C^-1 (G, P, L)."""
        local = self.local.copy()
        index = np.arange(local.shape[-1])
        diagonal = local[:, index, index]
        # A parameter without influence keeps its value.
        local[:, index, index] += (damping + 1e-15) * diagonal + np.where(diagonal > 0, 0.0, 1.0)
        inverse = np.asarray(np.linalg.inv(local), float)
        gain = self.cross @ inverse
        count = len(self.shared)
        wide = (count, self.local_gradient.size)
        flat = gain.transpose(1, 0, 2).reshape(wide)
        schur = self.shared - flat @ self.cross.transpose(1, 0, 2).reshape(wide).T
        diagonal = np.diagonal(self.shared)
        schur[np.diag_indices(count)] += damping * diagonal + np.where(diagonal > 0, 0.0, 1.0)
        return schur, self.shared_gradient - flat @ self.local_gradient.ravel(), inverse, gain

    def solve(self, damping: float) -> Array:
        """Return the step (P + G L,): the shared parameters, then those of each group."""
        try:
            schur, right, inverse, gain = self.reduced(damping)
            shared = -_solve_scaled(schur, right)
        except np.linalg.LinAlgError:
            return np.full(self.shared_gradient.size + self.local_gradient.size, np.nan)
        local = -(inverse @ self.local_gradient[..., None])[..., 0] - shared @ gain
        return np.concatenate([shared, local.ravel()])

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step."""
        count = len(self.shared)
        a, b = step[:count], step[count:].reshape(self.local_gradient.shape)
        linear = self.shared_gradient @ a + (self.local_gradient * b).sum()
        along = a @ self.shared @ a + 2 * ((a @ self.cross) * b).sum()
        along += ((self.local @ b[..., None])[..., 0] * b).sum()
        return float(-linear - 0.5 * along)

    def shared_covariance(self) -> Array:
        """Return the covariance (P, P) of the shared parameters for residuals of unit variance.

        Zero for a parameter without influence, and very large along unobservable directions.
        """
        half = self.half_covariance()
        return half @ half.T

    def half_covariance(self) -> Array:
        """Return L^-T (P, Q) of the Schur complement L L^T of the Q parameters with influence."""
        schur, _, _, _ = self.reduced()
        own = np.diagonal(self.shared)
        used = own > 0
        # Where the groups absorb a parameter completely, only rounding remains of the diagonal.
        left = np.where(used, np.maximum(np.diagonal(schur), MIN_EIGENVALUE * own), 1.0)
        scale = used / np.sqrt(left)
        values, vectors = np.linalg.eigh((scale[:, None] * schur * scale)[np.ix_(used, used)])
        half = np.zeros((len(scale), len(values)))
        half[used] = scale[used, None] * vectors / np.sqrt(np.maximum(values, MIN_EIGENVALUE))
        return half


def _solve_scaled(matrix: Array, right: Array) -> Array:
    # Scale to unit diagonal: the parameters differ by orders of magnitude (px, px^-3).
    if not len(right):
        return right
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    with np.errstate(over="ignore", invalid="ignore"):  # a diagonal of rounding errors has no finite step
        return scale * np.linalg.solve(matrix * scale[:, None] * scale, scale * right)
