"""Points that frames have in common, and points that are divided between frames with few of them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

Indices = NDArray[np.intp]


def common_points(frame: Indices, point: Indices) -> csr_array:
    """Return the number of points that each two frames have in common (F, F), given their observations (M,)."""
    shape = int(frame.max()) + 1, int(point.max()) + 1
    seen = csr_array(coo_array((np.ones(len(frame), np.int32), (frame, point)), shape=shape))
    seen.data[:] = 1  # several images of a frame see a point once
    return csr_array(seen @ seen.T)


def frames_with_common_points(common: csr_array, least: int) -> NDArray[np.bool_]:
    """Return which pairs of frames (F, F) have at least this number of points in common."""
    pairs, is_connected = common.tocoo(), np.eye(len(common.indptr) - 1, dtype=bool)
    enough = pairs.data >= least
    is_connected[pairs.row[enough], pairs.col[enough]] = True
    return is_connected


def nearest_frames(common: csr_array, count: int) -> NDArray[np.bool_]:
    """Return which pairs of frames (F, F): one is among those with which the other has most points in common."""
    pairs, is_connected = common.tocoo(), np.eye(len(common.indptr) - 1, dtype=bool)
    order = np.lexsort((pairs.col, -np.asarray(pairs.data, np.intp), pairs.row))
    order = order[(pairs.row != pairs.col)[order]]
    row, column = pairs.row[order], pairs.col[order]
    is_near = np.arange(len(row)) - np.searchsorted(row, row) < count
    is_connected[row[is_near], column[is_near]] = True
    return is_connected | is_connected.T


def divided_points(frame: Indices, point: Indices, is_connected: NDArray[np.bool_]) -> Indices:
    """Return the part (M,) of each observation: of a point between frames that are connected in pairs.

    Parameters
    ----------
    frame, point
        (M,) indices of the observations, sorted by point.
    is_connected
        (F, F) pairs of frames.
    """
    from omnisight.sfm._track_kernel import divide_tracks

    part, starts = np.empty(len(frame), np.intp), np.searchsorted(point, np.arange(int(point[-1]) + 2))
    divide_tracks(starts, frame, is_connected, part)
    return part
