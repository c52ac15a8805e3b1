"""Fitting one camera to bearings and their pixels."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from omnisight.models._protocol import Array, CameraModel
from omnisight.optim.dense import least_squares

SKETCH = 250  # pairs that are enough to tell a good start from a bad one
WEAK = 1e-5  # px, what a parameter one standard deviation from 0 weighs
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
    """Refine a camera on bearings and pixels; give it and half its sum of squares (px^2).

    A parameter of which something is known beforehand (`Parameter.prior_sigma`) is drawn to 0, by next to nothing.
    """
    # What falls out of the domain costs as much as the whole image, so that no step gains by losing points.
    lost = float(np.ptp(pixels, axis=0).max()) + 1.0

    def difference(seen: Array) -> Array:
        d = seen - pixels
        if start.period:  # across the seam
            d[:, 0] -= start.period * np.round(d[:, 0] / start.period)
        return np.where(np.isfinite(d), d, lost)

    # What is known of a parameter beforehand decides only what the pairs leave open.
    prior = WEAK / start.prior_sigmas
    known = prior > 0
    by_prior = np.diag(prior)[known]

    def residuals(params: Array) -> Array:
        d = difference(start.with_params(params).project_numpy(bearings)[0])
        return np.append(d, by_prior @ params)

    def derivatives(params: Array) -> tuple[Array, Array]:
        seen, _, _, d_params = start.with_params(params).project_with_jacobians(bearings)
        jacobian = np.where(np.isfinite(d_params), d_params, 0.0).reshape(-1, params.size)
        return np.append(difference(seen), by_prior @ params), np.concatenate([jacobian, by_prior])

    low, high = start.bounds
    free = np.array([name not in fixed for name in start.param_names])
    solution = least_squares(
        residuals,
        derivatives,
        start.params.copy(),
        low=low,
        high=high,
        free=free,
        iterations=iterations,
        tolerance=tolerance,
    )
    return start.with_params(solution.state), solution.cost
