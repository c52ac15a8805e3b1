"""Images with the lines that a calibration used drawn in."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibration.lines import LinesCalibration, PixelChains
from omnisight.calibration.lines.plumb_line import tangent_bases
from omnisight.images import read_image, to_gray8, write_image
from omnisight.images.output_paths import drawing_paths

USED, REFUSED, CIRCLE = (60, 230, 60), (255, 60, 60), (60, 110, 230)
WIDE = 1600  # px; images are drawn about so large
STEPS = 720
MOST_CIRCLES = 60


def draw_lines(
    found: LinesCalibration, arcs: PixelChains, paths: Sequence[Path], folder: Path, *, apply_exif: bool = False
) -> None:
    """Draw into a copy of every image: lines green, arcs that are no lines red, the great circles of lines blue."""
    files = drawing_paths(paths, folder)
    folder.mkdir(parents=True, exist_ok=True)
    for i, (path, file) in enumerate(zip(paths, files, strict=True)):
        write_image(file, _drawn(found, arcs, i, to_gray8(read_image(path, apply_exif=apply_exif))))


def _drawn(found: LinesCalibration, arcs: PixelChains, picture: int, gray: Any) -> Any:
    import cv2

    zoom = max(round(WIDE / max(gray.shape)), 1)
    canvas = cv2.cvtColor(cv2.resize(gray, None, fx=zoom, fy=zoom), cv2.COLOR_GRAY2RGB) // 2

    def stroke(pixels: Any, color: tuple[int, int, int], thick: int) -> None:
        at = np.rint(((pixels + 0.5) * zoom - 0.5) * 16).astype(np.int32)
        cv2.polylines(canvas, [at], False, color, thick, cv2.LINE_AA, 4)

    here = np.flatnonzero(found.lines.image_ids == picture)
    longest = here[np.argsort(-found.lines.arc_lengths[here], kind="stable")][:MOST_CIRCLES]
    for normal in found.state.normals[longest]:
        for piece in _great_circle(found, normal, gray.shape):
            stroke(piece, CIRCLE, 1)
    for arc in np.flatnonzero(arcs.image_ids == picture):
        stroke(arcs.pixels[arcs.groups[arc]], USED if found.line_of_arc[arc] >= 0 else REFUSED, 2)
    said = f"{len(here)} lines, rms {found.rms:.3f} px"
    cv2.rectangle(canvas, (0, 0), (16 * len(said), 40), (0, 0, 0), -1)
    cv2.putText(canvas, said, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas


def _great_circle(found: LinesCalibration, normal: Any, shape: tuple[int, int]) -> list[Any]:
    """Give the pieces (n, 2) of a great circle's image that lie in the image and within the reach of the lines."""
    turn = np.linspace(0, 2 * np.pi, STEPS)
    first, second = tangent_bases(normal[None])[0].T
    bearings = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    pixels, valid = found.camera.model.project_numpy(bearings)
    reach = found.camera.theta_max or np.pi
    with np.errstate(invalid="ignore"):
        shown = valid & (bearings[:, 2] > np.cos(reach)) & ((pixels > 0) & (pixels < shape[::-1])).all(1)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], shown, [False]]).astype(np.int8)))
    return [pixels[a:b] for a, b in zip(ends[::2], ends[1::2], strict=True) if b - a > 1]
