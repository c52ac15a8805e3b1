"""Fitting one camera to bearings and their pixels."""

from typing import TypeVar

import numpy as np

from omnisight.models._protocol import Array, CameraModel
from omnisight.optim.dense import least_squares

Model = TypeVar("Model", bound=CameraModel)


def fit(cls: type[Model], bearings: Array, pixels: Array) -> Model:
    """Refine each start of the model and keep the best; see `CameraModel.fit`."""
    if len(bearings) != len(pixels) or len(bearings) < 4:
        raise ValueError(f"fit needs 4 or more pairs, got {len(bearings)} bearings and {len(pixels)} pixels")
    best, best_cost, starts = None, np.inf, 0
    for start in cls.starts(bearings, pixels):
        starts += 1
        refined, cost = refine(start, bearings, pixels)
        if cost < best_cost:
            best, best_cost = refined, cost
    if best is None:
        raise ValueError(
            f"{cls.name} cannot be fitted to these {len(bearings)} bearings: they reach"
            f" {np.degrees(np.arccos((bearings[:, 2] / np.linalg.norm(bearings, axis=1)).min())):.0f} degrees from the axis"
        )
    return best


def refine(start: Model, bearings: Array, pixels: Array, *, iterations: int = 60) -> tuple[Model, float]:
    """Refine a camera on bearings and pixels; give it and half its sum of squares (px^2)."""
    scale = np.ptp(pixels, axis=0).max() + 1.0

    def residuals(params: Array) -> tuple[Array, Array]:
        model = start.with_params(params)
        seen, valid, _, d_params = model.project_with_jacobians(bearings)
        difference = seen - pixels
        if model.period:  # across the seam
            difference[:, 0] -= model.period * np.round(difference[:, 0] / model.period)
        # What falls out of the domain costs as much as the whole picture, so that no step gains by losing points.
        difference[~valid] = scale
        d_params[~valid] = 0.0
        d_params[~np.isfinite(d_params)] = 0.0
        difference[~np.isfinite(difference)] = scale
        return difference.ravel(), d_params.reshape(-1, params.size)

    low = np.array([p.low for p in start.parameters])
    high = np.array([p.high for p in start.parameters])
    solution = least_squares(residuals, start.params.copy(), low=low, high=high, iterations=iterations)
    return start.with_params(solution.state), solution.cost
