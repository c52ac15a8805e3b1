"""Subpixel sides of markers: fit a blurred, slightly curved edge to the gray levels along each side."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.subpixel.interpolation import bilinear
from omnisight.targets.subpixel.point_fits import BLUR_RANGE_PX, MAX_ITERATIONS, MIN_AMPLITUDE, ROUNDING_VARIANCE

Array = NDArray[np.float64]

# Part of a side that is sampled on either side of its middle: at its ends there is more than one edge.
HALF_SAMPLED_SHARE = 0.45
# Half width of the sampled strip over the cell or the gap, whichever is smaller, and its maximum: what is farther away
# adds error, not information.
STRIP_SHARE = 0.65
MAX_HALF_STRIP_PX = 3.0
# Samples along a side, and across it.
SAMPLES_ALONG, SAMPLES_ACROSS = (12, 48), (7, 17)
# Side of a cell, px, below which the cells inside the border blur into the edge.
MIN_CELL_PX = 2.0
# Four levels, three coefficients of the edge and its blur.
NUM_PARAMETERS = 8
# Distance, px, over which neighbouring samples share noise, by interpolation and by the compression of the image.
CORRELATION_PX = 2.5


class Sides(NamedTuple):
    """Sides of markers in the image, K in all.

    Attributes
    ----------
    middle, along, inward : (K, 2) arrays
        Middle of the straight line between both ends, unit vector from the first end to the second, unit vector into
        the marker.
    length : (K,) array
        Distance of the ends, px.
    depth : (K, 2) array
        Side of a cell across the side, px, at both ends.
    bend : (K,) array
        Curvature: the side runs through middle + s length along + bend (s^2 - 1/4) inward, s from -1/2 to 1/2.
    """

    middle: Array
    along: Array
    inward: Array
    length: Array
    depth: Array
    bend: Array


class SideFits(NamedTuple):
    """Fitted sides; NaN where a fit failed.

    A side is e0 + e1 s + e2 s^2 inward of where it was expected.

    Attributes
    ----------
    edge : (K, 3) array
        e0, e1, e2, px.
    covariance : (K, 3, 3) array
        Of `edge`, for uncorrelated noise.
    amplitude : (K,) array
        Half the contrast in gray levels, positive if the marker is the darker side.
    blur : (K,) array
        Standard deviation, px.
    explained : (K,) array
        Share of the variance that the model explains.
    inflation : float
        Factor of the covariance for noise that neighbouring samples share.
    """

    edge: Array
    covariance: Array
    amplitude: Array
    blur: Array
    explained: Array
    inflation: float


class _Strips(NamedTuple):
    """Samples around the sides: position along it (S,), inwards (K, T) and gray levels (K, S, T).

    `inner` (K, N) is 1 where the cell inside the border is white, per cell along the side; `depth` and `gap` (K, S) are
    the widths of the border and of the paper outside, px.
    """

    s: Array
    x: Array
    values: Array
    inner: Array
    depth: Array
    gap: Array
    length: Array


class _Model(NamedTuple):
    """Residuals (K, P), Jacobian (K, P, 8) and levels (K, 4) at given edges and blurs."""

    residual: Array
    jacobian: Array
    levels: Array


def fit_sides(gray: NDArray[Any], sides: Sides, inner_cells: NDArray[np.bool_], gap_cells: Array) -> SideFits:
    """Fit a blurred edge to each side: paper and the next marker outside, the black border and the cells behind it.

    The edge is quadratic along the side, because a lens bends it; both gray levels vary linearly. Damped Gauss-Newton
    iterations solve for all sides at once.

    Parameters
    ----------
    gray : (H, W) array
    sides : Sides
        Good to half a cell.
    inner_cells : (K, N) array of bool
        Which cells next to the border are white, from the first end to the second; the first and last are the border's.
    gap_cells : (K,) array
        Gap to the next marker, in cells; inf where there is none.
    """
    count = len(sides.length)
    strips = _sample(gray, sides, inner_cells, gap_cells)
    usable = np.isfinite(strips.values).all(axis=(1, 2)) & (sides.depth.min(axis=1) >= MIN_CELL_PX)
    fits = SideFits(
        np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan), *np.full((3, count), np.nan), inflation=1.0
    )
    variation = strips.values.var(axis=(1, 2))
    usable &= np.nan_to_num(variation) > MIN_AMPLITUDE**2
    if not usable.any():
        return fits
    strips = _Strips(strips.s, *(array[usable] for array in strips[1:]))
    theta, model = _gauss_newton(strips)
    samples = model.residual.shape[1]
    cost = (model.residual**2).sum(axis=1)
    noise = np.maximum(cost / (samples - NUM_PARAMETERS), ROUNDING_VARIANCE)
    normal = np.swapaxes(model.jacobian, 1, 2) @ model.jacobian
    fits.edge[usable] = theta[:, :3]
    fits.covariance[usable] = noise[:, None, None] * np.linalg.inv(normal + 1e-9 * np.eye(NUM_PARAMETERS))[:, :3, :3]
    fits.amplitude[usable], fits.blur[usable] = model.levels[:, 2] / 2, np.exp(theta[:, 3])
    fits.explained[usable] = 1 - cost / (variation[usable] * samples)
    return fits._replace(inflation=_noise_inflation(strips, model.residual, fits.explained[usable] > 0.8))


def _sample(gray: NDArray[Any], sides: Sides, inner_cells: NDArray[np.bool_], gap_cells: Array) -> _Strips:
    """Sample a strip around each side; gray levels are NaN outside of the image."""
    half = np.minimum(STRIP_SHARE * np.minimum(1.0, gap_cells) * sides.depth.min(axis=1), MAX_HALF_STRIP_PX)
    known = np.isfinite(half)
    length, width = (float(np.median(a[known])) if known.any() else 0.0 for a in (sides.length, 2 * half))
    s = np.linspace(-1, 1, int(np.clip(2 * HALF_SAMPLED_SHARE * length, *SAMPLES_ALONG))) * HALF_SAMPLED_SHARE
    x = half[:, None] * np.linspace(-1, 1, int(np.clip(width, *SAMPLES_ACROSS)))
    on_side = sides.middle[:, None] + (s[:, None] * sides.length[:, None, None]) * sides.along[:, None]
    on_side += ((s * s - 0.25)[:, None] * sides.bend[:, None, None]) * sides.inward[:, None]
    pixels = on_side[:, :, None] + x[:, None, :, None] * sides.inward[:, None, None]
    inside = ((pixels >= 0) & (pixels <= np.array(gray.shape[::-1]) - 1)).all(axis=-1)
    values = np.where(inside, bilinear(gray, pixels), np.nan)
    depth = sides.depth[:, :1] * (0.5 - s) + sides.depth[:, 1:] * (0.5 + s)
    return _Strips(s, x, values, inner_cells.astype(np.float64), depth, depth * gap_cells[:, None], sides.length)


def _gauss_newton(strips: _Strips) -> tuple[Array, _Model]:
    """Return the edge coefficients and the logarithm of the blur (K, 4), and the model there."""
    half = strips.x[:, -1]
    # The mean over a profile shows which part of it is paper.
    low, high = (np.percentile(strips.values, p, axis=(1, 2))[:, None] for p in (10, 90))
    share = np.clip((strips.values.mean(axis=2) - low) / np.maximum(high - low, 1e-9), 0, 1)
    outside_bright = strips.values[..., 0].mean(axis=1) > strips.values[..., -1].mean(axis=1)
    position = half[:, None] * (2 * np.where(outside_bright[:, None], share, 1 - share) - 1)
    line = np.linalg.pinv(np.stack([np.ones_like(strips.s), strips.s], axis=1))
    theta = np.zeros((len(half), 4))
    theta[:, :2] = position @ line.T
    theta[:, 3] = np.log(np.clip(0.3 * half, 0.5, 1.5))
    for _ in range(MAX_ITERATIONS):
        model = _evaluate(strips, theta)
        normal = np.swapaxes(model.jacobian, 1, 2) @ model.jacobian
        diagonal = np.einsum("kii->ki", normal)[:, :, None] * np.eye(NUM_PARAMETERS)
        damped = normal + 1e-4 * diagonal + 1e-9 * np.eye(NUM_PARAMETERS)
        gradient = np.einsum("kpi,kp->ki", model.jacobian, model.residual)
        step = np.linalg.solve(damped, gradient[..., None])[:, :4, 0]
        limit = np.stack([0.4 * half, half, half, np.full_like(half, 0.4)], axis=1)
        theta = theta + np.clip(step, -limit, limit)
        theta[:, :3] = np.clip(theta[:, :3], -4 * half[:, None], 4 * half[:, None])
        theta[:, 3] = np.clip(theta[:, 3], *np.log(BLUR_RANGE_PX))
    return theta, _evaluate(strips, theta)


def _evaluate(strips: _Strips, theta: Array) -> _Model:
    """Solve for the levels, which are linear, at given edges and blurs (variable projection)."""
    from scipy.special import ndtr  # imported on use: scipy is slow to import

    count, num_s, num_x = strips.values.shape
    s = np.broadcast_to(strips.s[:, None], strips.values.shape)
    edge = theta[:, :1] + theta[:, 1:2] * strips.s + theta[:, 2:3] * strips.s**2
    blur = np.exp(theta[:, 3])[:, None, None]
    t = (strips.x[:, None] - edge[:, :, None]) / blur
    behind = t - strips.depth[:, :, None] / blur
    beyond = t + strips.gap[:, :, None] / blur
    border, inner = (share[:, :, None] for share in _shares(strips, blur[:, :, 0]))
    paper = 1 - border * (ndtr(t) + ndtr(-beyond)) + inner * ndtr(behind)
    # Cells and the next marker move with the edge.
    densities = [np.exp(-0.5 * a * a) / np.sqrt(2 * np.pi) for a in (t, behind, beyond)]
    by_edge = (border * (densities[0] - densities[2]) - inner * densities[1]) / blur
    by_blur = border * (densities[0] * t - densities[2] * np.nan_to_num(beyond, posinf=0.0))
    by_blur -= inner * densities[1] * behind
    basis = np.stack([np.ones_like(s), s, paper, s * paper], axis=-1).reshape(count, num_s * num_x, 4)
    values = strips.values.reshape(count, -1)
    normal = np.swapaxes(basis, 1, 2) @ basis + 1e-9 * np.eye(4)
    levels = np.linalg.solve(normal, np.einsum("kpi,kp->ki", basis, values)[..., None])[..., 0]
    contrast = levels[:, 2, None, None] + levels[:, 3, None, None] * s
    slopes = np.stack([by_edge, by_edge * s, by_edge * s * s, by_blur], axis=-1) * contrast[..., None]
    jacobian = np.concatenate([slopes.reshape(count, -1, 4), basis], axis=2)
    return _Model(values - np.einsum("kpi,ki->kp", basis, levels), jacobian, levels)


def _shares(strips: _Strips, blur: Array) -> tuple[Array, Array]:
    """Return how dark the border is and how white the cells behind it are (K, S), blurred along the side.

    The border ends at the corners, where blur rounds it.
    """
    from scipy.special import ndtr  # imported on use: scipy is slow to import

    cells = strips.inner.shape[1]
    limits = np.arange(cells + 1) / cells - 0.5
    t = (limits - strips.s[:, None]) * (strips.length[:, None] / blur)[:, :, None]
    shares = np.diff(ndtr(t), axis=2)
    return shares.sum(axis=2), np.einsum("ksn,kn->ks", shares, strips.inner)


def _noise_inflation(strips: _Strips, residual: Array, good: NDArray[np.bool_]) -> float:
    """Return the sum of the residuals' autocorrelation over neighbouring samples, 1 if they are independent."""
    if not good.any():
        return 1.0
    grid = residual.reshape(strips.values.shape)[good]
    steps = (
        float(np.median(strips.length[good])) * (strips.s[1] - strips.s[0]),
        float(np.median(strips.x[good, 1] - strips.x[good, 0])),
    )
    lags = [min(int(CORRELATION_PX / step), n - 1) for step, n in zip(steps, grid.shape[1:], strict=True)]
    padded = np.pad(grid, [(0, 0), (lags[0], lags[0]), (lags[1], lags[1])])
    near = np.zeros_like(grid)
    for i in range(2 * lags[0] + 1):
        for j in range(2 * lags[1] + 1):
            near += padded[:, i : i + grid.shape[1], j : j + grid.shape[2]]
    return float((grid * near).sum() / max(float((grid**2).sum()), 1e-9))
