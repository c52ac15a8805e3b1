"""Images with their detected corners."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnisight.images import read_image, write_image
from omnisight.progress import StageProgress, no_progress
from omnisight.report.drawings.canvas import BLUE, GREEN, RED, YELLOW, Color, ImageCanvas, display_zoom
from omnisight.targets import Detection, Detections, ImageDetection

# Ellipses of corner covariances are drawn at this many standard deviations, to be visible.
ELLIPSE_SIGMAS = 100


def draw_detections(
    detections: Detections,
    files: Sequence[Path],
    *,
    apply_exif: bool = False,
    progress: StageProgress = no_progress,
) -> None:
    """Draw the corners of each image, row by row, and the boundaries of the image field.

    A square marks the first corner of a board. Ellipses are the covariances of the corners, magnified.

    Parameters
    ----------
    detections
        The detection results.
    files
        One output file per image; no file is written for images that could not be read.
    apply_exif
        Whether the images were rotated by their EXIF orientation.
    progress
        Called with the number of images done and the total.
    """
    if files:
        files[0].parent.mkdir(parents=True, exist_ok=True)
    for i, (image, file) in enumerate(zip(detections.images, files, strict=True)):
        if image.size is not None:
            write_image(file, _draw(image, detections, apply_exif).pixels)
        progress(i + 1, len(files))


def draw_board_rows(canvas: ImageCanvas, detection: Detection, detections: Detections, color: Color = YELLOW) -> None:
    """Connect the corners of each row of a board; a target of given points has no rows."""
    columns = getattr(detections.board, "columns", 1)
    for row in np.unique(detection.ids // columns):
        canvas.polyline(detection.pixels[detection.ids // columns == row], color)


def _draw(image: ImageDetection, detections: Detections, apply_exif: bool) -> ImageCanvas:
    pixels = read_image(image.path, apply_exif=apply_exif)
    canvas = ImageCanvas(pixels, display_zoom((pixels.shape[1], pixels.shape[0])))
    canvas.field(detections.field, BLUE)
    for detection in image.boards:
        draw_board_rows(canvas, detection, detections)
        in_field = np.ones(len(detection), bool)
        if detections.field is not None:
            in_field = detections.field.contains(detection.pixels)
        for pixel, covariance, inside in zip(detection.pixels, detection.covariance, in_field, strict=True):
            variances, axes = np.linalg.eigh(covariance)
            angle_deg = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
            canvas.ellipse(pixel, ELLIPSE_SIGMAS * np.sqrt(variances[::-1]), angle_deg, GREEN if inside else RED)
        canvas.square(detection.pixels[0], RED)
    corners = sum(map(len, image.boards))
    caption = f"{detections.board}: {corners} corners, ellipses {ELLIPSE_SIGMAS} sigma" if corners else image.note
    canvas.caption(caption)
    return canvas
