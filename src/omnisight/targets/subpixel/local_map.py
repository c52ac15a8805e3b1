"""Local quadratic map from a board to the image: no lens model, only smooth distortion is assumed."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Anchors that a map is fitted to: four times the six coefficients.
NUM_ANCHORS = 24
# Weight of a zero prior on second-order terms, which few anchors leave undetermined.
CURVATURE_PRIOR = 0.03
# Smallest variance of the anchors in any direction, in pitches squared: less is a line, which determines no map.
MIN_ANCHOR_VARIANCE = 0.01


class LocalMap(NamedTuple):
    """Board-to-image map around each of N board points; NaN where the anchors do not determine it.

    Attributes
    ----------
    pixels : (N, 2) array
        Images of the points.
    jacobian : (N, 2, 2) array
        d pixel / d board, px per unit of the board; columns belong to the board's x and y.
    bends : (N, 2, 2) array
        Second-order terms along the board's x (first row) and y, px per unit squared: a line of the board runs
        through pixel + s jacobian[:, k] + s^2 bends[k].
    """

    pixels: Array
    jacobian: Array
    bends: Array

    def window(self, length: float) -> tuple[Array, Array]:
        """Return the steps and bends (N, 2, 2), px, of a window whose sides are a length in the board's unit."""
        return self.jacobian.transpose(0, 2, 1) * length, self.bends * length**2

    @property
    def min_scale(self) -> Array:
        """Smaller length (N,), px, of a unit along the board's x and along its y."""
        return np.linalg.norm(self.jacobian, axis=1).min(axis=1)


def local_map(
    board: Array, pixels: Array, weights: Array, targets: Array, pitch: float, *, leave_out: bool = False
) -> LocalMap:
    """Fit a quadratic polynomial around each target to the nearest anchors, with Gaussian weights of width `pitch`.

    Parameters
    ----------
    board, pixels : (M, 2) arrays
        The anchors, on the board and in the image.
    weights : (M,) array
        Relative inverse variances.
    targets : (N, 2) array
        Points on the board.
    pitch : float
        Distance between anchors on the board, about.
    leave_out : bool
        Leave an anchor out of the map at its own position, where the others then predict it.
    """
    from scipy.spatial import KDTree  # imported on use: scipy is slow to import

    count = len(targets)
    if len(board) < 3 or count == 0:
        return LocalMap(*(np.full((count, *shape), np.nan) for shape in ((2,), (2, 2), (2, 2))))
    distance, nearest = KDTree(board).query(targets, k=min(NUM_ANCHORS + leave_out, len(board)))
    offset = (board[nearest] - targets[:, None]) / pitch
    weight = weights[nearest] * np.exp(-0.5 * (distance / pitch) ** 2)
    if leave_out:
        weight = np.where(distance > 1e-6 * pitch, weight, 0.0)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    x, y = offset[..., 0], offset[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    weighted = basis * weight[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ basis
    variance = normal[:, 1:3, 1:3] - normal[:, 1:3, :1] * normal[:, :1, 1:3]
    determined = np.linalg.eigvalsh(variance)[:, 0] > MIN_ANCHOR_VARIANCE
    normal += np.diag([1e-9, 1e-9, 1e-9, CURVATURE_PRIOR, CURVATURE_PRIOR, CURVATURE_PRIOR])
    # Centred: the prior must not depend on the image's origin.
    anchors = pixels[nearest]
    mean = (weight[..., None] * anchors).sum(axis=1)
    terms = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ (anchors - mean[:, None]))
    terms = np.where(determined[:, None, None], terms, np.nan)
    return LocalMap(mean + terms[:, 0], np.swapaxes(terms[:, 1:3], 1, 2) / pitch, terms[:, [3, 5]] / pitch**2)
