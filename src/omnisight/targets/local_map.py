"""The map from a board to the image, near one point: no lens is assumed, only that it bends smoothly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

Array = NDArray[np.float64]

_NEAREST = 24
"""How many anchors count for one point, the nearest."""

_WIDTH = 1.0
"""Standard deviation, in pitches, of the Gaussian by which an anchor counts less the farther it is."""

_TAME = 0.03
"""Weight that holds second-order terms at zero where the anchors say nothing of them."""

_FLAT = 0.01
"""Least variance of the anchors, in pitches squared, in any direction: less is a line, and no map follows from it."""


class LocalMap(NamedTuple):
    """The map around N board points; NaN where the anchors do not tell it.

    Attributes
    ----------
    pixels : (N, 2) array
        Where the points should be.
    jacobian : (N, 2, 2) array
        d pixel / d board, px for each unit of the board; columns are the board's x and y.
    bends : (N, 2, 2) array
        Second-order terms along the board's x (first row) and y, px for each unit squared: a line of the board runs
        through pixel + s jacobian[:, k] + s^2 bends[k].
    """

    pixels: Array
    jacobian: Array
    bends: Array

    def window(self, reach: float) -> tuple[Array, Array]:
        """Give what a fit takes, steps and bends (N, 2, 2) in px, for steps of a length in the board's unit."""
        return self.jacobian.transpose(0, 2, 1) * reach, self.bends * reach**2


def local_map(
    board: Array, pixels: Array, weights: Array, targets: Array, pitch: float, *, leave_out: bool = False
) -> LocalMap:
    """Fit a second-order polynomial around each target to the anchors near it.

    Parameters
    ----------
    board, pixels : (M, 2) arrays
        The anchors, on the board and in the image.
    weights : (M,) array
        How much each is to be trusted: an inverse variance, of any scale near 1.
    targets : (N, 2) array
        On the board.
    pitch : float
        The length on the board that is near: about the distance between anchors.
    leave_out : bool
        Whether an anchor says nothing about itself, so that the others judge it.
    """
    count = len(targets)
    if len(board) < 3 or count == 0:
        return LocalMap(*(np.full((count, *shape), np.nan) for shape in ((2,), (2, 2), (2, 2))))
    distance, nearest = KDTree(board).query(targets, k=min(_NEAREST + leave_out, len(board)))
    away = (board[nearest] - targets[:, None]) / pitch
    weight = weights[nearest] * np.exp(-0.5 * (distance / pitch / _WIDTH) ** 2)
    if leave_out:
        weight = np.where(distance > 1e-6 * pitch, weight, 0.0)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
    x, y = away[..., 0], away[..., 1]
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    weighted = basis * weight[..., None]
    normal = np.swapaxes(weighted, 1, 2) @ basis
    spread = normal[:, 1:3, 1:3] - normal[:, 1:3, :1] * normal[:, :1, 1:3]
    known = np.linalg.eigvalsh(spread)[:, 0] > _FLAT
    normal += np.diag([1e-9, 1e-9, 1e-9, _TAME, _TAME, _TAME])
    # About the mean, so that holding terms at zero does not depend on where the image's origin is.
    seen = pixels[nearest]
    mean = (weight[..., None] * seen).sum(axis=1)
    terms = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ (seen - mean[:, None]))
    terms = np.where(known[:, None, None], terms, np.nan)
    return LocalMap(mean + terms[:, 0], np.swapaxes(terms[:, 1:3], 1, 2) / pitch, terms[:, [3, 5]] / pitch**2)
