"""Estimation of the vertical from the lines of a scene: great circles of vertical lines meet at the zenith."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed

Array = NDArray[np.float64]

# The vertical is searched for within this angle of the guess: other directions of a scene are 90 degrees away.
MAX_TILT_RAD = float(np.radians(30.0))
# Gradient (rms), grey levels per px, above which a pixel is on an edge, and the number of edge pixels used.
MIN_GRADIENT, MAX_EDGES = 4.0, 20000
# Standard deviation of the window, px, in which the gradient must have one direction, and the coherence of a line.
TENSOR_PX, MIN_COHERENCE = 5.0, 0.8
# Latitude beyond which the pixels of a sphere are too stretched.
MAX_LATITUDE_RAD = float(np.radians(60.0))
# Scale of the deviation of the edges of vertical lines: the direction of a gradient is known to about a degree.
EDGE_SIGMA_RAD, ROUNDS = float(np.radians(1.5)), 30
# The same for the start, since trunks and walls lean, and the standard deviation of the tilt of a camera that is held.
START_SIGMA_RAD, TILT_SIGMA_RAD = float(np.radians(4.0)), float(np.radians(12.0))
# Edge pixels of one line err together: about as many pixels per line as a line is long.
PIXELS_PER_LINE = 50
# Largest standard deviation of a usable vertical, and edges that it needs.
MAX_SIGMA_DEG, MIN_EDGES = 2.0, 500


@dataclass(frozen=True, eq=False)
class Vertical(Displayed):
    """The direction up.

    Attributes
    ----------
    up
        (3,) in the rig frame.
    tilt_deg
        Angle from the guess.
    sigma_deg
        Standard deviation about the more uncertain axis.
    edges
        Number of edge pixels of vertical lines.
    reason
        Why the vertical is unknown; empty otherwise.
    """

    up: Array
    tilt_deg: float
    sigma_deg: float
    edges: int
    reason: str = ""


def estimate_vertical(image: NDArray[Any], bearings: NDArray[Any], guess: Array) -> Vertical:
    """Estimate the direction up from the edges of an equirectangular image.

    Parameters
    ----------
    image
        (H, W, 3) of uint8.
    bearings
        (H, W, 3) directions of its pixels in the rig frame.
    guess
        (3,) direction up, known to 30 degrees.
    """
    normals = _edge_normals(image, np.asarray(bearings, float))
    # A vertical line's great circle contains the vertical: its normal is horizontal.
    normals = normals[np.abs(normals @ guess) < np.sin(MAX_TILT_RAD)]
    if len(normals) < MIN_EDGES:
        return Vertical(guess, 0.0, float("nan"), len(normals), f"only {len(normals)} edge pixels are near vertical")
    # The start is the best of a grid: robust estimates have several minima.
    basis = np.linalg.svd(guess[None])[2][1:]
    steps = np.tan(np.linspace(-MAX_TILT_RAD, MAX_TILT_RAD, 31))
    trials = guess + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) @ basis
    trials /= np.linalg.norm(trials, axis=1, keepdims=True)
    few = normals[:: max(1, len(normals) // 3000)]
    score = np.array([(1 / (1 + (few @ t / START_SIGMA_RAD) ** 2)).sum() for t in trials])
    prior = np.exp(-0.5 * (np.arccos(np.clip(trials @ guess, -1, 1)) / TILT_SIGMA_RAD) ** 2)
    up = trials[int((score * prior).argmax())]
    information = np.eye(2)
    weight = np.ones(len(normals))
    for _ in range(ROUNDS):
        basis = np.linalg.svd(up[None])[2][1:]
        residual = normals @ up
        weight = 1 / (1 + (residual / EDGE_SIGMA_RAD) ** 2) ** 2
        design = normals @ basis.T
        information = (design * weight[:, None]).T @ design
        up = up - np.linalg.solve(information, design.T @ (weight * residual)) @ basis
        up /= np.linalg.norm(up)
    variance = float((weight * (normals @ up) ** 2).sum() / max(weight.sum(), 1)) * PIXELS_PER_LINE
    sigma = float(np.degrees(np.sqrt(variance / max(np.linalg.eigvalsh(information)[0], 1e-9))))
    tilt = float(np.degrees(np.arccos(np.clip(up @ guess, -1, 1))))
    reason = "" if sigma < MAX_SIGMA_DEG else f"its standard deviation of {sigma:.1f}° is too large"
    return Vertical(up, tilt, sigma, int(weight.sum()), reason)


def _edge_normals(image: NDArray[Any], bearings: Array) -> Array:
    """Return normals (N, 3) of the great circles along edges: the directions of gradients on the sphere."""
    import cv2

    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), 1.5)
    wrapped = np.pad(gray, ((0, 0), (4, 4)), "wrap")
    right, down = (cv2.Sobel(wrapped, cv2.CV_32F, *d)[:, 4:-4] / 8 for d in ((1, 0), (0, 1)))
    height = gray.shape[0]
    latitude = ((np.arange(height) + 0.5) / height - 0.5) * np.pi
    cosine = np.maximum(np.cos(latitude), 0.1)[:, None]
    right = right / cosine
    # The structure tensor distinguishes lines from leaves: it has one direction along a line.
    xx, xy, yy = (cv2.GaussianBlur(p, (0, 0), TENSOR_PX) for p in (right * right, right * down, down * down))
    coherence = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, 1e-6)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    low = np.abs(latitude) < MAX_LATITUDE_RAD
    rows, columns = np.nonzero((coherence > MIN_COHERENCE) & (xx + yy > MIN_GRADIENT**2) & low[:, None])
    if len(rows) > MAX_EDGES:
        kept = np.linspace(0, len(rows) - 1, MAX_EDGES).astype(int)
        rows, columns = rows[kept], columns[kept]
    at = bearings[rows, columns]
    width = gray.shape[1]
    east = bearings[rows, (columns + 1) % width] - bearings[rows, columns - 1]
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    south = np.cross(at, east)  # x right, y down, z forward: forward x right = down
    turn = angle[rows, columns, None]
    gradient = np.cos(turn) * east + np.sin(turn) * south
    return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
