"""Subpixel ellipses: fit a blurred ellipse to the image of each disc."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.subpixel.corner_fit import MAX_HALF_SIDE_PX
from omnisight.targets.subpixel.point_fits import (
    BLUR_RANGE_PX,
    MAX_ITERATIONS,
    MIN_AMPLITUDE,
    ROUNDING_VARIANCE,
    PointFits,
)

Array = NDArray[np.float64]

# Radius, px, below which a disc is a blurred point.
MIN_RADIUS_PX = 1.2
# Four coefficients of the light and six other parameters, each of which needs two pixels.
NUM_PARAMETERS = 10
# Relative decrease of the cost that ends the fit.
TOLERANCE = 1e-4
# Error, px, of the model itself: a lens does not map a disc to an exact ellipse.
MODEL_ERROR_PX = 0.01

# Nonlinear parameters: centre, entries xx, xy, yy of the symmetric matrix that maps the ellipse to the unit circle, and
# the logarithm of the blur.
U, V, XX, XY, YY, LOG_BLUR = range(6)


class _Window(NamedTuple):
    """Gray levels (M,) and their offsets (M, 2) from the start."""

    values: Array
    offsets: Array


class _Solution(NamedTuple):
    """Parameters with their cost, the coefficients of the light, the residuals (M,) and the Jacobian (M, 10)."""

    theta: Array
    cost: float
    light: Array
    residual: Array
    jacobian: Array


def fit_ellipses(gray: NDArray[Any], pixels: Array, matrices: Array, clearance: float) -> PointFits:
    """Fit a blurred ellipse, under light that varies linearly, to the image around each disc.

    Parameters
    ----------
    gray : (H, W) array of uint8
    pixels : (N, 2) array
        Centres, good to a third of the radius.
    matrices : (N, 2, 2) array
        Each maps the unit circle to the ellipse, px.
    clearance : float
        Radius of the window over that of the disc: nothing else may be within.

    Returns
    -------
    PointFits
        Of the centres of the ellipses, which are not the images of the discs' centres: see
        `boards.circles.disc_centroid_offset`.
    """
    fits = PointFits.empty(len(pixels))
    power = np.zeros(2)
    for k in range(len(pixels)):
        power += _fit_ellipse(gray, pixels[k], matrices[k], clearance, k, fits)
    # Noise that neighbouring pixels share averages out less. The statistics of blocks of pixels that `corner_fit` uses
    # serve worse here: around a disc they take the model error for noise, and miss noise that blur spreads (mean
    # normalized squared error 0.3 to 0.9 and 0.7 to 1.8, against 0.6 to 1.2).
    return fits.with_noise_inflation(1 + power[1] / max(power[0], 1e-9), MODEL_ERROR_PX)


def _fit_ellipse(gray: NDArray[Any], start: Array, matrix: Array, clearance: float, row: int, fits: PointFits) -> Array:
    """Fit one ellipse into a row of `fits`, if it is one; return the power of the noise and of its correlation."""
    failed = np.zeros(2)
    if not (np.isfinite(start).all() and np.isfinite(matrix).all()):
        return failed
    rotation, axes, _ = np.linalg.svd(matrix)
    if axes[1] < MIN_RADIUS_PX:
        return failed
    whitening = rotation / axes @ rotation.T
    window = _window(gray, start, whitening, clearance)
    if window is None:
        return failed
    values = window.values
    variation = float(((values - values.mean()) ** 2).sum())
    if variation < MIN_AMPLITUDE**2 * len(values):
        return failed
    initial = np.array([0, 0, whitening[0, 0], whitening[0, 1], whitening[1, 1], 0.0])
    solution = _gauss_newton(window, initial, max_shift=0.3 * axes[1])
    if solution is None or np.hypot(*solution.theta[:2]) > 0.6 * axes[0] + 1:
        return failed
    jacobian, theta = solution.jacobian, solution.theta
    noise = max(solution.cost / (len(values) - NUM_PARAMETERS), ROUNDING_VARIANCE)
    normal = jacobian.T @ jacobian
    fits.pixels[row] = start + theta[:2]
    fits.covariance[row] = noise * np.linalg.inv(normal + 1e-9 * np.eye(len(normal)))[:2, :2]
    fits.amplitude[row], fits.blur[row] = solution.light[3] / 2, np.exp(theta[LOG_BLUR])
    fits.explained[row] = 1 - solution.cost / variation
    return _noise_power(solution.residual, window.offsets + start)


def _gauss_newton(window: _Window, initial: Array, max_shift: float) -> _Solution | None:
    """Minimize the squared residuals by damped Gauss-Newton; None if the ellipse degenerates."""
    best: _Solution | None = None
    theta, damping = initial, 1e-3
    for _ in range(MAX_ITERATIONS):
        trial = _evaluate(theta, window)
        if best is None or trial.cost <= best.cost:
            converged = best is not None and best.cost - trial.cost < TOLERANCE * trial.cost
            best = trial
            damping *= 0.1
            if converged:
                break
        else:
            damping *= 20
            if damping > 1e4:
                break
        normal = best.jacobian.T @ best.jacobian
        damped = normal + np.diag(damping * normal.diagonal() + 1e-9)
        step = np.linalg.solve(damped, best.jacobian.T @ best.residual)[:6]
        shift = max(float(np.abs(step[:2]).max()), 1e-12)
        step *= min(1.0, max_shift / shift, 0.4 / max(abs(step[LOG_BLUR]), 1e-12))
        theta = np.asarray(best.theta + step, np.float64)
        theta[LOG_BLUR] = np.clip(theta[LOG_BLUR], *np.log(BLUR_RANGE_PX))
        if theta[XX] * theta[YY] <= theta[XY] ** 2 or theta[XX] <= 0:
            return None
    return best


def _evaluate(theta: Array, window: _Window) -> _Solution:
    """Solve for the light, which is linear, at given parameters (variable projection, Golub and Pereyra 1973)."""
    disc, slopes = _blurred_ellipse(theta, window.offsets)
    basis = np.column_stack([np.ones(len(disc)), window.offsets, disc])
    light = np.asarray(np.linalg.lstsq(basis, window.values, rcond=None)[0], np.float64)
    residual = window.values - basis @ light
    return _Solution(theta, float(residual @ residual), light, residual, np.column_stack([slopes * light[3], basis]))


def _window(gray: NDArray[Any], centre: Array, whitening: Array, clearance: float) -> _Window | None:
    """Collect the pixels around a disc; None if they are too few."""
    reach = clearance * np.sqrt(np.diag(np.linalg.inv(whitening @ whitening)))
    low = np.maximum(np.ceil(centre - reach), 0).astype(int)
    high = np.minimum(np.floor(centre + reach), np.array(gray.shape[::-1]) - 1).astype(int)
    if (high <= low).any():
        return None
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    offsets = np.stack([u.ravel(), v.ravel()], axis=1) - centre
    radius, distance, _, _ = _edge_distance(whitening, offsets)
    near = (radius < clearance) & (np.abs(distance) < MAX_HALF_SIDE_PX[0])
    if near.sum() < 2 * NUM_PARAMETERS:
        return None
    values = gray[low[1] : high[1] + 1, low[0] : high[0] + 1].ravel()[near].astype(np.float64)
    return _Window(values, offsets[near])


def _edge_distance(whitening: Array, offsets: Array) -> tuple[Array, Array, Array, Array]:
    """Return radius (1 on the ellipse), distance inside (px, first order), gradient of the radius, whitened offsets."""
    white = offsets @ whitening
    radius = np.sqrt((white**2).sum(axis=1)) + 1e-9
    slope = np.sqrt(((white @ whitening) ** 2).sum(axis=1)) / radius + 1e-9
    return radius, (1 - radius) / slope, slope, white


def _blurred_ellipse(theta: Array, offsets: Array) -> tuple[Array, Array]:
    """Return the blurred ellipse, 0 outside to 1 inside, and its derivatives (M, 6) by the parameters.

    A blurred straight edge is the normal distribution function; the curvature of an ellipse's edge is the same on
    opposite sides, so it does not move the centre.
    """
    from scipy.special import ndtr  # imported on use: scipy is slow to import

    whitening = np.array([[theta[XX], theta[XY]], [theta[XY], theta[YY]]])
    shifted = offsets - theta[:2]
    radius, distance, slope, white = _edge_distance(whitening, shifted)
    blur = np.exp(theta[LOG_BLUR])
    t = distance / blur
    density = np.exp(-0.5 * t * t) / np.sqrt(2 * np.pi) / blur
    by_square = -density / slope / radius  # derivative by half the squared radius
    x, y = shifted.T
    return ndtr(t), np.column_stack(
        [
            -by_square[:, None] * (white @ whitening),
            by_square * white[:, 0] * x,
            by_square * (white[:, 0] * y + white[:, 1] * x),
            by_square * white[:, 1] * y,
            -density * distance,
        ]
    )


def _noise_power(residual: Array, pixels: Array) -> Array:
    """Return the residuals' sum of squares, and the sum of their products over all shifts of up to two pixels."""
    at = np.rint(pixels).astype(int)
    at -= at.min(axis=0) - 2
    image = np.zeros(at.max(axis=0) + 3)
    image[at[:, 0], at[:, 1]] = residual
    near = sum(image[at[:, 0] + i, at[:, 1] + j] for i in range(-2, 3) for j in range(-2, 3)) - residual
    return np.array([residual @ residual, residual @ near])
