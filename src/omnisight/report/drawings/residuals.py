"""Images with the residuals of their corners."""

from pathlib import Path
from typing import Any

import numpy as np

from omnisight.images import read_image, write_image
from omnisight.images.output_paths import drawing_paths
from omnisight.report.drawings.canvas import GREEN, RED, ImageCanvas, blank_image, display_zoom
from omnisight.report.drawings.detections import draw_board_rows
from omnisight.targets import Detections, ImageDetection, PointTarget
from omnisight.targets.observations import Observations

# Residuals are drawn this many times longer than they are, to be visible.
RESIDUAL_SCALE = 50


def draw_residuals(
    observations: Observations, residuals: Any, outliers: Any, folder: Path, *, apply_exif: bool = False
) -> int:
    """Draw the corners, their order and their magnified residuals over each image with a board.

    Parameters
    ----------
    observations
        The corners, with their detection results.
    residuals
        (N, 2) projected minus detected pixels of all corners.
    outliers
        (N,) which corners are outliers, drawn red.
    folder
        Where the drawings are written, with the names of the images.
    apply_exif
        Whether the images were rotated by their EXIF orientation.

    Returns
    -------
    Number of images drawn on a blank background, since only their corners were given and their file is missing.
    """
    detections = observations.detections
    assert detections is not None
    images = [(image.detection, image.rows) for image in observations.images if image.detection and image.views]
    files = drawing_paths([image.path for image, _ in images], folder)
    folder.mkdir(parents=True, exist_ok=True)
    num_blank = 0
    for (image, rows), file in zip(images, files, strict=True):
        is_blank = isinstance(detections.board, PointTarget) and not image.path.is_file()
        num_blank += is_blank
        pixels = blank_image(image.size or (1, 1)) if is_blank else read_image(image.path, apply_exif=apply_exif)
        canvas = ImageCanvas(pixels, display_zoom((pixels.shape[1], pixels.shape[0])))
        _draw(canvas, image, detections, residuals[rows], outliers[rows])
        write_image(file, canvas.pixels)
    return num_blank


def _draw(canvas: ImageCanvas, image: ImageDetection, detections: Detections, residuals: Any, outliers: Any) -> None:
    for detection in image.boards:
        draw_board_rows(canvas, detection, detections)
    corners = np.concatenate([detection.pixels for detection in image.boards])
    for corner, residual, is_outlier in zip(corners, residuals, outliers, strict=True):
        color = RED if is_outlier else GREEN
        canvas.ellipse(corner, np.zeros(2), 0.0, color)
        if np.isfinite(residual).all():
            canvas.polyline([corner, corner + RESIDUAL_SCALE * residual], color)
    finite = np.isfinite(residuals).all(1)
    rms = np.sqrt((residuals[finite] ** 2).sum(1).mean()) if finite.any() else np.nan
    canvas.caption(f"residuals x{RESIDUAL_SCALE}, rms {rms:.3f} px")
