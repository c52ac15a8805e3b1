"""The rotation between two cameras in one place."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.twoview.bearing_pairs import BearingPairsProblem, whitening

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RotationProblem(BearingPairsProblem):
    """The rotation b_from_a (3, 3) of two cameras in one place, as a problem of `estimate_robustly`."""

    sample_size = 2
    max_solutions = 1
    dimension = 2

    def compiled(self, order: NDArray[np.intp]) -> Any:
        """Return the problem with isotropic variances."""
        from omnisight.twoview._alignment_problems_kernel import CompiledRotation

        rows = self.pairs.a, self.pairs.b, self.pairs.variance
        return CompiledRotation(*(np.ascontiguousarray(row[order]) for row in rows))

    def state(self, model: Array) -> Array:
        """Return the rotation of [R | 0]."""
        return model[:, :3].copy()

    def linearize(self, state: Array) -> tuple[Array, Array]:
        """Return the whitened chords (N, 2) between R a and b, NaN beyond 90 degrees, and Jacobians (N, 2, 3)."""
        turned = self.pairs.a @ state.T
        maps = self._maps(state)
        residuals = np.einsum("nki,ni->nk", maps, turned - self.pairs.b)
        residuals[(turned * self.pairs.b).sum(1) <= 0] = np.nan
        return residuals, -maps @ so3.hat(turned)

    def by_translation(self, state: Array) -> Array:
        """Return the derivatives (N, 2, 3) of the residuals by a translation, for points at the distance 1."""
        turned = self.pairs.a @ state.T
        return self._maps(state) @ (np.eye(3) - turned[:, :, None] * turned[:, None, :])

    def _maps(self, state: Array) -> Array:
        """Return the maps (N, 2, 3) of chords to residuals of unit variance."""
        pairs = self.pairs
        return whitening(pairs.b, pairs.covariance_b + state @ pairs.covariance_a @ state.T)

    def feature(self, state: Array) -> None:
        """Return None: the share of outliers is the same for all pairs."""
        return

    def retract(self, state: Array, step: Array) -> Array:
        """Rotate by a rotation vector in frame b."""
        return so3.exp(step) @ state
