"""Points that frames have in common, and points that are divided between frames with few of them."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def common_points(count: int, frame: Indices, point: Indices) -> csr_array:
    """Return the number of points that each two of F frames have in common (F, F), given their observations (M,)."""
    shape = count, int(point.max(initial=-1)) + 1
    seen = csr_array(coo_array((np.ones(len(frame), np.int32), (frame, point)), shape=shape))
    seen.data[:] = 1  # several images of a frame see a point once
    return csr_array(seen @ seen.T)


def frames_with_common_points(common: csr_array, least: int) -> NDArray[np.bool_]:
    """Return which pairs of frames (F, F) have at least this number of points in common."""
    pairs = common.tocoo()
    enough = pairs.data >= least
    return _connections(len(common.indptr) - 1, pairs.row[enough], pairs.col[enough])


def strongly_connected_frames(frame: Indices, point: Indices, distance: Array, least: float) -> NDArray[np.bool_]:
    """Return which pairs of frames (F, F) have this share of the points of either in common, weighted by distance.

    The weight of an observation at a distance d is min(1, m / d), with the median m of its frame: far points say little
    about the relative position of two frames, and connect frames that are far apart.

    Parameters
    ----------
    frame, point
        (M,) indices of the observations.
    distance
        (M,) of the points from the frames.
    least
        Least share of the sum of the products of the weights.
    """
    order = np.lexsort((distance, frame))
    starts = np.searchsorted(frame[order], np.arange(int(frame.max()) + 2))
    median = distance[order][(starts[:-1] + starts[1:] - 1) // 2]
    weights = np.minimum(1.0, median[frame] / np.maximum(distance, np.finfo(float).tiny))
    seen = csr_array(coo_array((weights, (frame, point))))
    common = seen @ seen.T
    pairs, total = common.tocoo(), common.diagonal()
    strong = pairs.data >= least * np.minimum(total[pairs.row], total[pairs.col])
    return _connections(len(total), pairs.row[strong], pairs.col[strong])


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


def _connections(count: int, row: NDArray[np.integer], column: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which pairs of frames (F, F) are among some (N,), or are one frame."""
    is_connected = np.eye(count, dtype=bool)
    is_connected[row, column] = True
    return is_connected
