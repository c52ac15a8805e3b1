"""Checks of board points and pixels given as arrays: shapes, finite values, corners outside the image, duplicates."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Asymmetry of a covariance matrix relative to its mean variance that is rounding.
COVARIANCE_TOLERANCE = 1e-6
# A corner at the edge of the image is located up to this distance beyond it, px.
EDGE_TOLERANCE_PX = 0.5
# Different corners are at least some pixels apart; equal ones agree up to rounding in a file.
SAME_PIXEL_PX = 1e-6
# Board points of a view agree to this fraction of its extent if they are the same point.
SAME_POINT = 1e-7
# Extent across a line over the extent along it, below which board points are collinear.
MIN_THICKNESS = 1e-3
# Distance (rms) of the pixels of a view from a line, px: less than the noise of corners.
MIN_PIXEL_THICKNESS_PX = 1e-2


def check_lists(board_points: Any, pixels: Any, covariance: Any) -> None:
    """Check that there is one array of each kind per view."""
    for name, values in (("board_points", board_points), ("pixels", pixels)):
        if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
            raise ValueError(f"{name} must be a list with one array per view, got {type(values).__name__}")
    if len(board_points) != len(pixels):
        raise ValueError(
            f"needs one array of each per view, got {len(board_points)} of points and {len(pixels)} of pixels"
        )
    if covariance is not None and len(covariance) != len(pixels):
        raise ValueError(f"needs one covariance array per view, got {len(covariance)} for {len(pixels)} views")


def checked_size(size: Any) -> tuple[int, int]:
    """Return the image size as (width, height)."""
    try:
        width, height = (int(side) for side in size)
    except (TypeError, ValueError):
        raise ValueError(f"size must be (width, height) in px, got {size!r}") from None
    if width < 0 or height < 0:
        raise ValueError(f"size must be (width, height) in px, got {size!r}")
    return width, height


def check_inside(names: Sequence[str], pixels: Sequence[Array], size: tuple[int, int]) -> None:
    """Raise ValueError with the first corner outside the image, if its size is known."""
    if not all(size) or not len(pixels):
        return
    outside = [_outside(p, size) for p in pixels]
    count = int(sum(o.sum() for o in outside))
    if not count:
        return
    view = next(i for i, o in enumerate(outside) if o.any())
    row = int(np.argmax(outside[view]))
    u, v = pixels[view][row]
    width, height = size
    total = sum(map(len, pixels))
    advice = "check the image size and the corners"
    if not any(_outside(p, (height, width)).any() for p in pixels):
        advice = f"exchange width and height: all corners lie inside {height}x{width}"
    raise ValueError(
        f"{names[view]}: row {row}: the corner at ({u:.1f}, {v:.1f}) is outside the image of {width}x{height} (width x"
        f" height), one of {count} of {total} corners; {advice}"
    )


def _outside(pixels: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return which pixels (N, 2) lie outside an image, with a tolerance for corners at its edge."""
    beyond = np.abs(pixels - (np.array(size) - 1) / 2) - np.array(size) / 2
    return beyond.max(axis=1) > EDGE_TOLERANCE_PX


def checked_view(
    name: str, board_points: ArrayLike, pixels: ArrayLike, covariance: ArrayLike | None
) -> tuple[Array, Array, Array]:
    """Return the points (n, 3), pixels (n, 2) and covariance (n, 2, 2) of one view, checked."""
    x, p = (_rows(values, name) for values in (board_points, pixels))
    c = np.zeros((len(x), 2, 2)) if covariance is None else np.asarray(covariance, float)
    if x.ndim != 2 or x.shape[1] not in (2, 3) or p.shape != (len(x), 2):
        got = f"{np.shape(board_points)} and {np.shape(pixels)}"
        raise ValueError(f"{name}: needs points (n, 3) or (n, 2) and pixels (n, 2), got {got}")
    if not len(x):
        raise ValueError(f"{name}: has no corners; leave it out")
    if c.shape != (len(x), 2, 2):
        raise ValueError(f"{name}: needs a covariance (n, 2, 2), got {c.shape} with {len(x)} corners")
    if not (finite := np.isfinite(x).all(1) & np.isfinite(p).all(1) & np.isfinite(c).all((1, 2))).all():
        k = int(np.argmin(finite))
        raise ValueError(
            f"{name}: row {k} is not finite: point {x[k].tolist()}, pixel {p[k].tolist()};"
            " leave out corners that were not observed"
        )
    if not (semidefinite := _are_covariances(c)).all():
        k = int(np.argmin(semidefinite))
        raise ValueError(f"{name}: row {k}: {c[k].tolist()} is not symmetric and positive semi-definite")
    _check_distinct(name, x, p)
    return (x if x.shape[1] == 3 else np.concatenate([x, np.zeros((len(x), 1))], 1)), p, c


def are_collinear(points: Array, pixels: Array) -> bool:
    """Return whether board points (N, 2 or 3) or their pixels (N, 2) lie on one line, which determines no pose."""
    return bool(_on_line(points, pixels))


def _on_line(points: Array, pixels: Array) -> str:
    """Return what lies on one line, "board points" or "pixels"; empty if neither does."""
    if len(points) < 3:
        return "board points"
    along, across = _extents(points)
    if across < MIN_THICKNESS * along:
        return "board points"
    return "pixels" if _extents(pixels)[1] < MIN_PIXEL_THICKNESS_PX else ""


def _check_distinct(name: str, points: Array, pixels: Array) -> None:
    """Raise ValueError if a board point or a pixel occurs twice, or the corners lie on one line."""
    extent = float(np.ptp(points, axis=0).max())
    is_plane = points.shape[1] == 2 or bool(np.ptp(points[:, 2]) <= SAME_POINT * extent)
    # The planes of a rigid body share the points of their common edges, each detected once per plane.
    if is_plane and (pair := _equal_rows(points, SAME_POINT * extent)) is not None:
        i, k = pair
        raise ValueError(
            f"{name}: rows {i} and {k} are the same board point {points[i].tolist()}, at the pixels"
            f" {pixels[i].tolist()} and {pixels[k].tolist()}; give each corner once"
        )
    if (pair := _equal_rows(pixels, SAME_PIXEL_PX)) is not None:
        i, k = pair
        raise ValueError(
            f"{name}: rows {i} and {k} are different board points at the same pixel {pixels[i].tolist()}; leave out"
            " corners that were not observed"
        )
    if what := _on_line(points, pixels):
        raise ValueError(f"{name}: the {what} lie on one line, which determines no pose; leave the image out")


def _equal_rows(rows: Array, tolerance: float) -> tuple[int, int] | None:
    """Return the first two rows (N, k) that agree within a tolerance, or None."""
    from scipy.spatial import KDTree

    pairs = KDTree(rows).query_pairs(tolerance, p=np.inf)
    return min(pairs) if pairs else None


def _extents(rows: Array) -> Array:
    """Return the two largest extents (rms) of rows (N, k) along their principal axes."""
    return np.linalg.svd(rows - rows.mean(0), compute_uv=False)[:2] / np.sqrt(len(rows))


def _rows(values: ArrayLike, name: str) -> Array:
    """Return an (n, k) array, also from (n, 1, k) or (1, n, k); any other shape unchanged."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: needs arrays of numbers: {error}") from None
    if array.ndim == 3 and 1 in array.shape[:2]:
        return array.reshape(-1, array.shape[2])
    return array


def _are_covariances(matrices: Array) -> NDArray[np.bool_]:
    """Return which matrices (N, 2, 2) are symmetric and, up to rounding, positive semi-definite."""
    a, b, c, d = matrices.reshape(-1, 4).T
    middle, half = (a + d) / 2, np.hypot((a - d) / 2, b)
    return (np.abs(b - c) <= COVARIANCE_TOLERANCE * middle) & (half <= middle * (1 + COVARIANCE_TOLERANCE))
