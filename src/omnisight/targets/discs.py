"""Where the middle of a disc's image is: a blurred ellipse fitted to the pixels, and how sure that is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from .grids.crossing import Crossings

Array = NDArray[np.float64]

_BAND = 10.0
"""Distance in px from the edge past which pixels say nothing more."""

_LEAST_PIXELS = 24
_LEAST_RADIUS = 1.2  # px
_ROUNDS = 15
_SETTLED = 1e-3  # px
_LOG_BLUR = (np.log(0.3), np.log(6.0))  # of px
_FEATURELESS = 4.0  # variance in a window, gray levels squared, below which there is nothing to fit
_ROUNDING = 1 / 12  # variance of a gray level rounded to a whole one

_FLOOR = 0.01
"""Error in px that no fit goes below: a lens does not quite make an ellipse of a disc."""

_MOST_CORRELATED = 8.0
"""How much correlated noise may widen a covariance: more is no noise."""


class _Disc(NamedTuple):
    """One fit; `power` are the residuals' sum of squares, and what neighbouring pixels share of it."""

    pixel: Array
    covariance: Array
    amplitude: float
    blur: float
    explained: float
    power: Array


def fit_discs(gray: NDArray[Any], pixels: Array, matrices: Array, clear: float) -> Crossings:
    """Fit a blurred ellipse, under light that may change across, to the image around each disc.

    Parameters
    ----------
    gray : (H, W) array of uint8
    pixels : (N, 2) array
        Middles, good to a third of the radius.
    matrices : (N, 2, 2) array
        Each maps the unit circle onto the ellipse, px.
    clear : float
        How far out the window goes, in radii: nothing else may be there.

    Returns
    -------
    Crossings
        Of the middles of the ellipses, which are not the images of the discs' middles: see `circle_shift` beside
        this. The amplitude is half the contrast, positive where the disc is brighter than what is around it.
    """
    count = len(pixels)
    found = Crossings(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), *np.full((3, count), np.nan))
    power = np.zeros(2)
    for k in range(count):
        disc = _fit(gray, pixels[k], matrices[k], clear)
        if disc is not None:
            for values, value in zip(found, disc, strict=False):
                values[k] = value
            power += disc.power
    # Noise that neighbouring pixels share averages out less. What crossing edges are widened by, the pulls of blocks of
    # pixels, serves worse here: around a disc it takes for noise what a lens leaves of an ellipse, and so too little of
    # the noise that blur spreads (mean normalised squared error 0.3 to 0.9 and 0.7 to 1.8, as against 0.6 to 1.2).
    widened = float(np.clip(1 + power[1] / max(power[0], 1e-9), 1.0, _MOST_CORRELATED))
    return found._replace(covariance=found.covariance * widened + _FLOOR**2 * np.eye(2))


def _fit(gray: NDArray[Any], pixel: Array, matrix: Array, clear: float) -> _Disc | None:
    """Fit one disc by Gauss and Newton; None if it is too small, not in the image, in plain gray, or no disc."""
    if not (np.isfinite(pixel).all() and np.isfinite(matrix).all()):
        return None
    turn, axes, _ = np.linalg.svd(matrix)
    if axes[1] < _LEAST_RADIUS:
        return None
    whiten = turn / axes @ turn.T
    window = _window(gray, pixel, whiten, clear)
    if window is None:
        return None
    values, offsets, corner = window
    variation = float(((values - values.mean()) ** 2).sum())
    if variation < _FEATURELESS * len(values):
        return None
    # Centre, the whitening matrix's entries xx, xy and yy, logarithm of the blur; then light and contrast.
    theta: Array = np.array([0, 0, whiten[0, 0], whiten[0, 1], whiten[1, 1], 0.0])
    cost, damping = np.inf, 1e-3
    best, light, jacobian, residual = theta, np.zeros(4), np.zeros((0, 0)), values
    for _ in range(_ROUNDS):
        shape, slopes = _model(theta, offsets)
        basis = np.column_stack([np.ones(len(values)), offsets, shape])
        # Light and contrast are linear: solved for exactly at every step (Golub and Pereyra 1973).
        now_light = np.linalg.lstsq(basis, values, rcond=None)[0]
        now_residual = values - basis @ now_light
        now = float(now_residual @ now_residual)
        if now <= cost:
            gain = cost - now
            cost, best, light, residual = now, theta, now_light, now_residual
            jacobian = np.column_stack([slopes * light[3], basis])
            damping *= 0.1
            if gain < 1e-4 * cost:
                break
        else:
            damping *= 20
            if damping > 1e4:
                break
        normal = jacobian.T @ jacobian
        # Not positive definite only where the disc has left the window.
        step = np.linalg.solve(normal + np.diag(damping * normal.diagonal() + 1e-9), jacobian.T @ residual)[:6]
        step *= min(1.0, 0.3 * axes[1] / max(float(np.abs(step[:2]).max()), 1e-12), 0.4 / max(abs(step[5]), 1e-12))
        theta = np.asarray(best + step, np.float64)
        theta[5] = np.clip(theta[5], *_LOG_BLUR)
        if theta[2] * theta[4] <= theta[3] ** 2 or theta[2] <= 0:
            return None
    normal = jacobian.T @ jacobian
    noise = max(cost / (len(values) - normal.shape[0]), _ROUNDING)
    if np.hypot(*best[:2]) > 0.6 * axes[0] + 1:
        return None
    covariance = noise * np.linalg.inv(normal + 1e-9 * np.eye(len(normal)))[:2, :2]
    power = _correlation(residual, offsets + corner)
    amplitude = light[3] / 2
    return _Disc(pixel + best[:2], covariance, amplitude, float(np.exp(best[5])), 1 - cost / variation, power)


def _window(gray: NDArray[Any], pixel: Array, whiten: Array, clear: float) -> tuple[Array, Array, Array] | None:
    """Give the values (M,) of the pixels around a disc, where they are from its middle (M, 2), and its middle."""
    reach = clear * np.sqrt(np.diag(np.linalg.inv(whiten @ whiten)))
    low = np.maximum(np.ceil(pixel - reach), 0).astype(int)
    high = np.minimum(np.floor(pixel + reach), np.array(gray.shape[::-1]) - 1).astype(int)
    if (high <= low).any():
        return None
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    offsets = np.stack([u.ravel(), v.ravel()], axis=1) - pixel
    level, distance = _distance(whiten, offsets)
    near = (level < clear) & (np.abs(distance) < _BAND)
    if near.sum() < _LEAST_PIXELS:
        return None
    values = gray[low[1] : high[1] + 1, low[0] : high[0] + 1].ravel()[near].astype(np.float64)
    return values, offsets[near], pixel


def _distance(whiten: Array, offsets: Array) -> tuple[Array, Array]:
    """Give how far out offsets are, 1 on the ellipse, and how far inside it in px: to first order, as near it."""
    white = offsets @ whiten
    level = np.sqrt((white**2).sum(axis=1)) + 1e-9
    slope = np.sqrt(((white @ whiten) ** 2).sum(axis=1)) / level + 1e-9
    return level, (1 - level) / slope


def _model(theta: Array, offsets: Array) -> tuple[Array, Array]:
    """Give the blurred disc, 0 outside to 1 inside, and its derivatives (M, 6) by the unknowns.

    A straight edge blurred is the normal distribution's function; the edge here bends, alike all around, so that its
    middle is not moved.
    """
    whiten = np.array([[theta[2], theta[3]], [theta[3], theta[4]]])
    away = offsets - theta[:2]
    level, distance = _distance(whiten, away)
    blur = np.exp(theta[5])
    t = distance / blur
    density = np.exp(-0.5 * t * t) / np.sqrt(2 * np.pi) / blur
    white = away @ whiten
    across = np.sqrt(((white @ whiten) ** 2).sum(axis=1)) / level + 1e-9
    falls = -density / across / level
    x, y = away.T
    return ndtr(t), np.column_stack(
        [
            -falls[:, None] * (white @ whiten),
            falls * white[:, 0] * x,
            falls * (white[:, 0] * y + white[:, 1] * x),
            falls * white[:, 1] * y,
            -density * distance,
        ]
    )


def _correlation(residual: Array, pixels: Array) -> Array:
    """Give the residuals' sum of squares, and twice their products over all shifts of up to two pixels."""
    at = np.rint(pixels).astype(int)
    at -= at.min(axis=0) - 2
    image = np.zeros(at.max(axis=0) + 3)
    image[at[:, 0], at[:, 1]] = residual
    near = sum(image[at[:, 0] + i, at[:, 1] + j] for i in range(-2, 3) for j in range(-2, 3)) - residual
    return np.array([residual @ residual, residual @ near])
