"""Fitting one camera to bearings and their pixels."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from omnisight.models._protocol import Array, CameraModel
from omnisight.optim.gauss_newton import gauss_newton

SKETCH = 250  # pairs that are enough to tell a good start from a bad one
PRIOR_WEIGHT_PX = 1e-5  # residual of a parameter one prior sigma from 0: it decides only what the pairs leave open
Model = TypeVar("Model", bound=CameraModel)


def fit(cls: type[Model], bearings: Array, pixels: Array, fixed: Sequence[str] = ()) -> Model:
    """Refine each start of the model a little, and the best to the end; see `CameraModel.fit`."""
    if len(bearings) != len(pixels) or len(bearings) < 4:
        raise ValueError(f"fit needs 4 or more pairs, got {len(bearings)} bearings and {len(pixels)} pixels")
    every = -(-len(bearings) // SKETCH)
    sketch = bearings[::every], pixels[::every]
    tried = [refine(start, *sketch, fixed, iterations=10, tolerance=1e-4) for start in cls.starts(bearings, pixels)]
    if not tried:
        farthest = np.degrees(np.arccos((bearings[:, 2] / np.linalg.norm(bearings, axis=1)).min()))
        raise ValueError(f"{cls.name} cannot be fitted to bearings up to {farthest:.0f} degrees from the axis")
    best, _ = min(tried, key=lambda found: found[1])
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
    # A point outside the domain costs as much as the whole image, so that no step gains by losing points.
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
