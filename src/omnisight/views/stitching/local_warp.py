"""Local warps that close the parallax along a seam, and the disparity that they remove."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.views.stitching.seams import Seam

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Angle from the seam at which a warp has ended: a parallax of 1 degree then stretches by 7 %.
FADE_RAD = float(np.radians(20.0))
# Rows on each side of the seam, as an angle, whose flow is averaged; standard deviation of smoothing along the seam.
WINDOW_RAD, ALONG_RAD = float(np.radians(2.0)), float(np.radians(0.8))
# Gradient, grey levels per px, at which a pixel counts half in averages of the flow.
TEXTURE = 8.0


class Disparity(NamedTuple):
    """Displacement of one image against the other along a seam.

    Attributes
    ----------
    flow
        (C, 2) along columns and rows, px of the polar grid: what the inner image shows at x the outer one shows at
        x + flow.
    weight
        (C,) texture in the window; 0 without overlap.
    median_px
        Weighted median length.
    """

    flow: Array
    weight: Array
    median_px: float


@dataclass(frozen=True, eq=False)
class SeamWarp:
    """Moves directions near a seam by a share of its disparity.

    Attributes
    ----------
    seam
        The seam.
    flow
        (C, 2) displacement, px of the polar grid.
    share
        Share of the displacement of this camera.
    """

    seam: Seam
    flow: Array
    share: float

    def __call__(self, bearings: Array) -> Array:
        grid, limits = self.seam.grid, self.seam.theta
        cosine = bearings @ grid.rig_from_axis[:, 2]
        low, high = np.clip([limits.min() - FADE_RAD, limits.max() + FADE_RAD], 0.0, np.pi)
        near = (cosine <= np.cos(low)) & (cosine >= np.cos(high))
        theta, column = grid.coordinates(bearings[near])
        columns = np.arange(grid.columns)
        across, along, limit = (
            np.interp(column, columns, values, period=grid.columns)
            for values in (self.flow[:, 1], self.flow[:, 0], limits)
        )
        t = np.clip(np.abs(theta - limit) / FADE_RAD, 0, 1)
        fade = self.share * (1 - t * t * (3 - 2 * t)) / grid.px_per_rad
        theta = theta + fade * across
        phi = (column + 0.5) / grid.px_per_rad + fade * along
        local = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
        warped = bearings.copy()
        warped[near] = local @ grid.rig_from_axis.T
        return warped


def measure_disparity(seam: Seam, inner: NDArray[Any], outer: NDArray[Any], overlap: Mask) -> Disparity:
    """Measure the displacement of the outer against the inner image (R, C, 3) along a seam by dense optical flow."""
    import cv2

    gray = [cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_RGB2GRAY) for image in (inner, outer)]
    # Where one image ends the other one continues it, so that its edge has no flow.
    both = cv2.erode(overlap.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mean = [float(g[both].mean()) if both.any() else 0.0 for g in gray]
    a = np.where(overlap, gray[0], np.uint8(mean[0]))
    b = np.where(overlap, gray[1], np.uint8(mean[0]))
    pad = 64
    wrapped = [np.ascontiguousarray(np.pad(x, ((0, 0), (pad, pad)), "wrap")) for x in (a, b)]
    flow_of = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    forward: Any = flow_of.calc(wrapped[0], wrapped[1], None)[:, pad:-pad]  # pyright: ignore
    rows = np.arange(len(a))[:, None]
    window = np.abs(rows - seam.row) <= WINDOW_RAD * seam.grid.px_per_rad
    slope = np.hypot(cv2.Sobel(a, cv2.CV_32F, 1, 0), cv2.Sobel(a, cv2.CV_32F, 0, 1)) / 8
    weight = window * both * (slope / (slope + TEXTURE))
    sigma = ALONG_RAD * seam.grid.px_per_rad
    total = _smooth(weight.sum(0), sigma)
    flow = np.stack([_smooth((weight * forward[..., k]).sum(0), sigma) / np.maximum(total, 1e-6) for k in range(2)], -1)
    flow *= np.minimum(total / (total + 0.05 * max(total.max(), 1e-6)), 1)[:, None]
    return Disparity(flow, total, _weighted_median(np.hypot(*flow.T), total))


def _smooth(values: Array, sigma: float) -> Array:
    """Return values (C,) of a closed curve, smoothed by a Gaussian."""
    frequency = np.fft.rfftfreq(len(values))
    return np.fft.irfft(np.fft.rfft(values) * np.exp(-2 * (np.pi * sigma * frequency) ** 2), len(values))


def _weighted_median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(np.maximum(weights[order], 0))
    return float(values[order][np.searchsorted(total, total[-1] / 2)]) if total[-1] > 0 else float("nan")
