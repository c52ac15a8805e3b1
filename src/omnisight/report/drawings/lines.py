"""Images with the straight lines that a calibration from lines used."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibration.lines import LinesCalibration
from omnisight.calibration.lines.plumb_line import tangent_bases
from omnisight.images import read_image, write_image
from omnisight.images.output_paths import drawing_paths
from omnisight.report.drawings.canvas import BLUE, GREEN, RED, ImageCanvas, display_zoom

# Points along a great circle: one per half degree.
CIRCLE_POINTS = 720
# Great circles drawn per image, of the longest lines.
MAX_CIRCLES = 60
# Brightness of the image below the lines.
BRIGHTNESS = 0.5


def draw_lines(calibration: LinesCalibration, paths: Sequence[Path], folder: Path, *, apply_exif: bool = False) -> None:
    """Draw lines (green), rejected arcs (red) and the great circles of the lines (blue) over each image.

    Parameters
    ----------
    calibration
        The calibration from lines.
    paths
        The images.
    folder
        Where the drawings are written, with the names of the images.
    apply_exif
        Whether the images were rotated by their EXIF orientation.
    """
    files = drawing_paths(paths, folder)
    folder.mkdir(parents=True, exist_ok=True)
    for i, (path, file) in enumerate(zip(paths, files, strict=True)):
        write_image(file, _draw(calibration, i, read_image(path, apply_exif=apply_exif)).pixels)


def _draw(calibration: LinesCalibration, image_id: int, image: Any) -> ImageCanvas:
    height, width = image.shape[:2]
    canvas = ImageCanvas(image, display_zoom((width, height)), gray=True, brightness=BRIGHTNESS)
    lines, arcs = calibration.lines, calibration.arcs
    in_image = np.flatnonzero(lines.image_ids == image_id)
    longest = in_image[np.argsort(-lines.arc_lengths[in_image], kind="stable")][:MAX_CIRCLES]
    for normal in calibration.state.normals[longest]:
        for piece in _great_circle(calibration, normal, (width, height)):
            canvas.polyline(piece, BLUE, 1)
    for arc in np.flatnonzero(arcs.image_ids == image_id):
        color = GREEN if calibration.line_of_arc[arc] >= 0 else RED
        canvas.polyline(arcs.pixels[arcs.groups[arc]], color, 2)
    canvas.caption(f"{len(in_image)} lines, rms {calibration.rms:.3f} px; red rejected, blue great circles")
    return canvas


def _great_circle(calibration: LinesCalibration, normal: Any, size: tuple[int, int]) -> list[Any]:
    """Return the pieces (n, 2) of a projected great circle inside the image and the calibrated field of view."""
    t = np.linspace(0, 2 * np.pi, CIRCLE_POINTS)
    first, second = tangent_bases(normal[None])[0].T
    bearings = np.cos(t)[:, None] * first + np.sin(t)[:, None] * second
    pixels, valid = calibration.camera.model.project_numpy(bearings)
    max_theta = calibration.camera.theta_max or np.pi
    with np.errstate(invalid="ignore"):
        visible = valid & (bearings[:, 2] > np.cos(max_theta)) & ((pixels > 0) & (pixels < size)).all(1)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], visible, [False]]).astype(np.int8)))
    return [pixels[start:stop] for start, stop in zip(ends[::2], ends[1::2], strict=True) if stop - start > 1]
