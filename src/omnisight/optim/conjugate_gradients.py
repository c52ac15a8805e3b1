"""Solution of symmetric positive definite systems by preconditioned conjugate gradients."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.parallel import serial_blas

Array = NDArray[np.float64]

# The iterations end when k times the last gain in the quadratic form is below this share of its sum over k iterations,
# and the residual, in units of the diagonal of the matrix, below this share of the right side.
GAIN_TOLERANCE, RESIDUAL_TOLERANCE, MAX_ITERATIONS = 1e-8, 1e-2, 500


class SymmetricMatrix(Protocol):
    """A symmetric matrix (C, C), dense or sparse."""

    def __matmul__(self, x: Any, /) -> Any:
        """Return the product (C,) with a vector (C,)."""
        ...

    def diagonal(self) -> Any:
        """Return the diagonal (C,)."""
        ...


@serial_blas()
def conjugate_gradients(matrix: SymmetricMatrix, precondition: Callable[[Array], Array], right: Array) -> Array:
    """Return the solution x (C,) of A x = right.

    M. Hestenes and E. Stiefel, Methods of conjugate gradients for solving linear systems, 1952. The number of
    iterations is that of the distinct eigenvalues of M^-1 A. They end by the gain in x^T A x / 2 - right^T x (S. Nash
    and A. Sofer, Assessing a search direction within a truncated-Newton method, 1990), unless the residual shows that
    it was small in one direction only.

    Parameters
    ----------
    matrix
        A, positive definite.
    precondition
        Return M^-1 r of a residual (C,), for a positive definite M close to A.
    right
        (C,).
    """
    x, residual = np.zeros_like(right), right.copy()
    direction = preconditioned = precondition(residual)
    square, total = float(residual @ preconditioned), 0.0
    inverse = 1 / matrix.diagonal()
    small = RESIDUAL_TOLERANCE**2 * float(right @ (inverse * right))
    for iteration in range(1, MAX_ITERATIONS + 1):
        if not square > 0.0:
            break
        product = matrix @ direction
        length = square / float(direction @ product)
        x += length * direction
        residual -= length * product
        gain = 0.5 * length * square
        total += gain
        if iteration * gain <= GAIN_TOLERANCE * total and float(residual @ (inverse * residual)) <= small:
            break
        preconditioned = precondition(residual)
        before, square = square, float(residual @ preconditioned)
        direction = preconditioned + square / before * direction
    return x
