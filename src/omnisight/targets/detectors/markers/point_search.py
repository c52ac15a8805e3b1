"""Find and measure the points of a board around its decoded markers, and on from there.

Each point is predicted by a smooth local map from the markers around it, then measured where two edges cross; measured
points predict the next ones. So points whose marker is too small or too distorted to be decoded are found as well.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards._marker_board import MarkerBoard, MarkerLayout
from omnisight.targets.detection_limits import MIN_EXPLAINED, MIN_RELATIVE_CONTRAST, SEARCH_RADIUS_STEPS
from omnisight.targets.detections import Detection
from omnisight.targets.detectors.markers.decoding import Markers
from omnisight.targets.subpixel.corner_fit import fit_corners
from omnisight.targets.subpixel.local_map import LocalMap, local_map
from omnisight.targets.subpixel.point_fits import MAX_ITERATIONS, PointFits

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

# Markers and points that a detection needs.
MIN_MARKERS, MIN_POINTS = 2, 4
# Step, px, below which a corner's window holds too few pixels: it is enlarged as far as the board permits.
MIN_WINDOW_STEP_PX = 5.0
# Standard deviation, px, above which a point is worthless, such as one whose window the image's edge cuts.
MAX_SIGMA_PX = 0.4
# Distance, px, to the image's edge: blur and sharpening distort markers' small squares there.
MIN_EDGE_DISTANCE_PX = 4.0
# Distance of a point from the prediction of its neighbours, over that to the next point; or a multiple of the median,
# where the print is uneven.
MAX_DEVIATION_STEPS, MAX_DEVIATION_MEDIANS = 0.18, 5.0
# Weight of a marker's corner, good to a pixel, relative to a measured point.
MARKER_WEIGHT = 0.02
# Attempts at a point, each with better neighbours, and passes that drop outliers: further ones thin out the rim.
MAX_ATTEMPTS = 3
# Starts around a prediction, in `SEARCH_RADIUS_STEPS`.
START_OFFSETS = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)], np.float64)


class _Predictions(NamedTuple):
    """What a fit must agree with: pixels (N, 2), the distance (N,) to them, px, and the colours (N,).

    The distance is half of that to the next point, which has the opposite colours.
    """

    pixels: Array
    max_distance: Array
    bright: NDArray[np.bool_]


def find_points(gray: Gray, markers: Markers, board: MarkerBoard) -> Detection | None:
    """Find the points of a board from its decoded markers; None if there are too few."""
    from scipy.spatial import KDTree  # imported on use: scipy is slow to import

    layout = board.layout
    if len(markers.ids) < min(MIN_MARKERS, len(layout.marker_corners)):
        return None
    count = len(layout.points)
    pixels, amplitude = np.full((count, 2), np.nan), np.full(count, np.nan)
    marker_points, marker_pixels = layout.marker_corners[markers.ids].reshape(-1, 2), markers.corners.reshape(-1, 2)
    attempts = np.zeros(count, np.int64)
    for _ in range(MAX_ITERATIONS):
        known = np.isfinite(pixels[:, 0])
        anchors = np.concatenate([marker_points, layout.points[known]])
        anchor_pixels = np.concatenate([marker_pixels, pixels[known]])
        weights = np.where(np.arange(len(anchors)) < len(marker_points), MARKER_WEIGHT, 1.0)
        near = KDTree(anchors).query(layout.points)[0] < 1.1 * layout.max_step
        wanted = np.flatnonzero(near & ~known & (attempts < MAX_ATTEMPTS))
        if not len(wanted):
            break
        attempts[wanted] += 1
        predicted = local_map(anchors, anchor_pixels, weights, layout.points[wanted], layout.pitch)
        found = _search(gray, board, wanted, predicted, attempts[wanted] > 1, np.abs(amplitude[known]))
        good = np.isfinite(found.pixels[:, 0])
        pixels[wanted[good]], amplitude[wanted[good]] = found.pixels[good], found.amplitude[good]
        if not np.isfinite(pixels).any():
            break
    return _remeasure(gray, _without_outliers(pixels, layout), board)


def measure(gray: NDArray[np.uint8], board: MarkerBoard, pixels: Array, steps: Array, bends: Array) -> PointFits:
    """Measure the crossings of edges near predicted pixels; enlarge the windows of small boards."""
    shortest = np.linalg.norm(steps, axis=2).min(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.clip(MIN_WINDOW_STEP_PX / shortest, 1.0, board.max_window_step / board.window_step)
    return fit_corners(gray, pixels, steps * scale[:, None, None], bends * scale[:, None, None] ** 2)


def _search(
    gray: Gray,
    board: MarkerBoard,
    ids: NDArray[np.int64],
    predicted: LocalMap,
    repeated: NDArray[np.bool_],
    amplitudes: Array,
) -> PointFits:
    """Fit points where they are predicted; those that were missed before, around there as well."""
    layout = board.layout
    max_distance = 0.5 * layout.min_step * predicted.min_scale
    expected = _Predictions(predicted.pixels, max_distance, board.bright_ahead[ids])
    window = predicted.window(board.window_step)
    result = PointFits.empty(len(ids))
    for offset in START_OFFSETS:
        missing = ~np.isfinite(result.pixels[:, 0]) & (repeated | (offset == 0).all())
        start = predicted.pixels + predicted.jacobian @ (offset * SEARCH_RADIUS_STEPS * layout.min_step)
        fits = measure(gray, board, np.where(missing[:, None], start, np.nan), *window)
        good = _is_point(gray, fits, expected, amplitudes)
        for values, new in zip(result, fits, strict=True):
            values[good] = new[good]
    return result


def _is_point(gray: Gray, fits: PointFits, expected: _Predictions, amplitudes: Array) -> NDArray[np.bool_]:
    """Return which fits are near their prediction, with the right colours and the contrast of the known points."""
    good = (fits.explained > MIN_EXPLAINED) & ((fits.amplitude > 0) == expected.bright)
    good &= np.linalg.norm(fits.pixels - expected.pixels, axis=1) < expected.max_distance
    last = np.array(gray.shape[::-1]) - 1
    good &= ((fits.pixels > MIN_EDGE_DISTANCE_PX) & (fits.pixels < last - MIN_EDGE_DISTANCE_PX)).all(axis=1)
    good &= np.trace(fits.covariance, axis1=1, axis2=2) < MAX_SIGMA_PX**2
    strength = np.abs(fits.amplitude)
    usual = np.median(amplitudes) if len(amplitudes) else np.median(strength[good]) if good.any() else 0.0
    return good & (strength > MIN_RELATIVE_CONTRAST * usual)


def _without_outliers(pixels: Array, layout: MarkerLayout) -> Array:
    """Return the pixels (N, 2) with NaN for those that their neighbours contradict."""
    from scipy.spatial import KDTree  # imported on use: scipy is slow to import

    pixels = pixels.copy()
    for _ in range(MAX_ATTEMPTS):
        known = np.flatnonzero(np.isfinite(pixels[:, 0]))
        if len(known) < MIN_POINTS:
            break
        points = layout.points[known]
        others = local_map(points, pixels[known], np.ones(len(known)), points, layout.pitch, leave_out=True)
        step = layout.min_step * others.min_scale
        deviation = np.linalg.norm(others.pixels - pixels[known], axis=1) / step
        deviation[~np.isfinite(deviation)] = np.inf
        # No two points share a place: of such a pair, drop the one that deviates more.
        distance, nearest = (np.asarray(a)[:, 1] for a in KDTree(pixels[known]).query(pixels[known], k=2))
        double = (distance < 0.5 * step) & (deviation >= deviation[nearest])
        limit = max(MAX_DEVIATION_STEPS, MAX_DEVIATION_MEDIANS * float(np.median(deviation)))
        outlier = double | (deviation > limit)
        if not outlier.any():
            break
        # An outlier makes its neighbours deviate: drop the worst first, then judge those around it again.
        pixels[known[outlier & (double | (deviation > 0.5 * deviation.max()))]] = np.nan
    return pixels


def _remeasure(gray: Gray, pixels: Array, board: MarkerBoard) -> Detection | None:
    """Measure the points again, with windows that follow their neighbours."""
    layout = board.layout
    known = np.flatnonzero(np.isfinite(pixels[:, 0]))
    if len(known) < MIN_POINTS:
        return None
    points = layout.points[known]
    near = local_map(points, pixels[known], np.ones(len(known)), points, layout.pitch)
    fits = measure(gray, board, pixels[known], *near.window(board.window_step))
    max_distance = 0.5 * layout.min_step * near.min_scale
    expected = _Predictions(pixels[known], max_distance, board.bright_ahead[known])
    good = _is_point(gray, fits, expected, np.zeros(0))
    if good.sum() < MIN_POINTS:
        return None
    return Detection(known[good], fits.pixels[good], fits.covariance[good], board=board)
