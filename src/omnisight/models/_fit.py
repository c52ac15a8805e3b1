"""Fit of a camera model to bearings and their pixels."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

import numpy as np

from omnisight.models._projector import Array, Projector
from omnisight.optim.gauss_newton import gauss_newton

# Pairs that suffice to compare initial models.
SUBSAMPLE_SIZE = 250
# Residual of a parameter one prior sigma from 0, px: the prior determines only what the pairs do not.
PRIOR_WEIGHT_PX = 1e-5
Model = TypeVar("Model", bound=Projector)


def fit_model(
    name: str, initial_models: Iterable[Model], bearings: Array, pixels: Array, fixed: Sequence[str] = ()
) -> Model:
    """Refine each initial model on a subsample, and the best one on all pairs; see `CameraModel.fit`."""
    if len(bearings) != len(pixels) or len(bearings) < 4:
        raise ValueError(f"fit needs 4 or more pairs, got {len(bearings)} bearings and {len(pixels)} pixels")
    every = -(-len(bearings) // SUBSAMPLE_SIZE)
    subsample = bearings[::every], pixels[::every]
    refined = [refine(model, *subsample, fixed, iterations=10, tolerance=1e-4) for model in initial_models]
    if not refined:
        largest = np.degrees(np.arccos((bearings[:, 2] / np.linalg.norm(bearings, axis=1)).min()))
        raise ValueError(f"{name} cannot be fitted to bearings up to {largest:.0f} degrees from the axis")
    best, _ = min(refined, key=lambda model_and_cost: model_and_cost[1])
    return refine(best, bearings, pixels, fixed)[0]


def refine(
    start: Model,
    bearings: Array,
    pixels: Array,
    fixed: Sequence[str] = (),
    *,
    iterations: int = 60,
    tolerance: float = 1e-12,
) -> tuple[Model, float]:
    """Refine a camera on bearings and pixels; return it and half its sum of squares (px^2).

    A parameter with a prior (`Parameter.prior_sigma`) is pulled to 0 by a negligible weight: the prior determines only
    what the pairs do not.
    """
    # A point outside the domain costs as much as the whole image: no step gains by losing points.
    lost_px = float(np.ptp(pixels, axis=0).max()) + 1.0
    prior = PRIOR_WEIGHT_PX / start.prior_sigmas
    prior_rows = np.diag(prior)[prior > 0]

    def linearize(params: Array) -> tuple[Array, Array]:
        projected, _, _, d_params = start.with_params(params).project_with_jacobians(bearings)
        difference = projected - pixels
        if start.period:  # across the seam
            difference[:, 0] -= start.period * np.round(difference[:, 0] / start.period)
        residuals = np.where(np.isfinite(difference), difference, lost_px).ravel()
        jacobian = np.where(np.isfinite(d_params), d_params, 0.0).reshape(-1, params.size)
        return np.append(residuals, prior_rows @ params), np.concatenate([jacobian, prior_rows])

    is_fixed = np.array([name in fixed for name in start.param_names])
    low, high = (np.where(is_fixed, start.params, bound) for bound in start.bounds)
    solution = gauss_newton(
        linearize, start.params.copy(), bounds=(low, high), max_iterations=iterations, tolerance=tolerance
    )
    return start.with_params(solution.state), solution.cost
