"""Drawings of a stereo pair: the rectified images, and distances in colours."""

import numpy as np
from numpy.typing import NDArray

from omnisight.pipeline.two_views.stereo import StereoResult
from omnisight.report.color_scale import viridis
from omnisight.report.drawings.canvas import WHITE, ImageCanvas, write_text

# Largest height of a rectified image and width of both.
MAX_HEIGHT_PX, MAX_WIDTH_PX = 1200, 2400
# Rows that are drawn as lines, and their colours in turn.
LINES = 16
LINE_COLORS = ((255, 210, 0), (0, 220, 255), (255, 110, 180))
GAP_PX, MARGIN_PX, BAR_PX, TEXT_PX = 12, 36, 18, 0.55
BACKGROUND = 24


def draw_rectified(result: StereoResult) -> NDArray[np.uint8]:
    """Draw both rectified images side by side, with lines along some rows: a point is on the same line in both.

    Returns
    -------
    (H, W, 3) RGB image.
    """
    view = result.rectification.camera
    zoom = min(MAX_HEIGHT_PX / view.height, MAX_WIDTH_PX / (2 * view.width), 2.0)
    canvases = [ImageCanvas(image, zoom) for image in result.rectified]
    height, width = canvases[0].pixels.shape[:2]
    page = np.full((MARGIN_PX + height, 2 * width + GAP_PX, 3), BACKGROUND, np.uint8)
    page[MARGIN_PX:, :width], page[MARGIN_PX:, -width:] = (canvas.pixels for canvas in canvases)
    for k in range(LINES):
        row = MARGIN_PX + round((k + 0.5) * height / LINES)
        page[row] = LINE_COLORS[k % len(LINE_COLORS)]
    check = result.check
    residual = f"row difference of {check.inliers} matches {check.row_px:.2f} px (median)"
    write_text(
        page, f"left and right; {residual}" if check.inliers else "left and right", (GAP_PX, MARGIN_PX - 12), TEXT_PX
    )
    return page


def draw_distances(result: StereoResult) -> NDArray[np.uint8]:
    """Draw the distances in the left image: yellow is near, dark blue far, on a logarithmic scale; black is unknown.

    Returns
    -------
    (H, W, 3) RGB image.

    Raises
    ------
    ValueError
        If the result has no distances.
    """
    if not result:
        raise ValueError(f"there are no distances to draw: {result.reason}")
    low, _, high = result.quantiles
    with np.errstate(invalid="ignore"):
        nearness = 1 - np.log(result.distance / low) / np.log(max(high / low, 1.001))
    drawn = viridis(nearness)
    drawn[~result.known] = 0
    height, width = drawn.shape[:2]
    page = np.full((height + MARGIN_PX, width, 3), BACKGROUND, np.uint8)
    page[:height] = drawn
    labels = (f"{low:.3g}", f"{high:.3g}")
    left, right = (GAP_PX + 11 * len(labels[0]), width - GAP_PX - 11 * len(labels[1]))
    top = height + (MARGIN_PX - BAR_PX) // 2
    page[top : top + BAR_PX, left:right] = viridis(np.linspace(1, 0, max(right - left, 1)))[: right - left]
    for label, position in zip(labels, (GAP_PX // 2, right + GAP_PX // 2), strict=True):
        write_text(page, label, (position, top + BAR_PX - 4), TEXT_PX, WHITE)
    return page
