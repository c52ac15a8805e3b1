"""Compiled normal equations of weighted residuals."""

# Compiled code takes its types from its arguments.
# pyright: basic

from omnisight.compiled import njit_inlined


@njit_inlined
def add_observation(weight, residual, jacobian, gradient, information):
    """Add one observation to the gradient J^T W r (P,) and to the lower triangle of J^T W J (P, P), in place.

    Parameters
    ----------
    weight
        Number.
    residual, jacobian
        (D,) and (D, P).
    gradient, information
        (P,) and (P, P).
    """
    dimension, parameters = jacobian.shape
    for d in range(dimension):
        for r in range(parameters):
            weighted = weight * jacobian[d, r]
            gradient[r] += weighted * residual[d]
            for c in range(r + 1):
                information[r, c] += weighted * jacobian[d, c]
