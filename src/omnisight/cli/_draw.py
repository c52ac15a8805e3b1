"""Pictures with what was found drawn in."""

from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibrate import Calibration
from omnisight.cli._names import outputs
from omnisight.images import read_image, to_gray8, write_image
from omnisight.targets import BoardSearch

GREEN, RED, YELLOW = (60, 220, 60), (255, 60, 60), (255, 220, 0)
# A residual is drawn this many times longer than it is.
EXAGGERATION = 50


def draw_residuals(search: BoardSearch, calibration: Calibration, folder: Path, *, apply_exif: bool = False) -> None:
    """Draw corners, their order and their residuals (50 times longer than they are) into a copy of every picture."""
    folder.mkdir(parents=True, exist_ok=True)
    residuals = calibration.state.residuals(calibration.views)
    files = outputs([picture.path for picture in search.found], folder)
    for picture, rows, file in zip(search.found, rows_of_pictures(search), files, strict=True):
        image = _as_rgb(read_image(picture.path, apply_exif=apply_exif))
        zoom = max(1, round(1600 / image.shape[1]))
        canvas = _draw(image, calibration.views.pixels[rows], residuals[rows], calibration.outliers[rows], zoom)
        write_image(file, canvas)


def rows_of_pictures(search: BoardSearch) -> list[slice]:
    """Give the rows of `BoardViews` that each picture with a board has."""
    ends = list(accumulate((sum(map(len, picture.boards)) for picture in search.found), initial=0))
    return [slice(start, stop) for start, stop in pairwise(ends)]


def _as_rgb(image: Any) -> Any:
    import cv2

    if image.ndim == 3 and image.dtype == np.uint8:
        return np.ascontiguousarray(image[..., :3])
    return cv2.cvtColor(to_gray8(image), cv2.COLOR_GRAY2RGB)


def _draw(image: Any, pixels: Any, residuals: Any, outliers: Any, zoom: int) -> Any:
    import cv2

    canvas = cv2.resize(image, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
    at = (pixels + 0.5) * zoom - 0.5

    def point(p: Any) -> tuple[int, int]:
        return round(float(p[0]) * 16), round(float(p[1]) * 16)  # cv2 draws in sixteenths with shift=4

    for a, b in pairwise(at):
        cv2.line(canvas, point(a), point(b), YELLOW, 1, cv2.LINE_AA, 4)
    for p, r, bad in zip(at, residuals, outliers, strict=True):
        color = RED if bad else GREEN
        cv2.circle(canvas, point(p), 4 * 16, color, 1, cv2.LINE_AA, 4)
        if np.isfinite(r).all():
            cv2.line(canvas, point(p), point(p + EXAGGERATION * zoom * r), color, 1, cv2.LINE_AA, 4)
    said = f"residuals x{EXAGGERATION}, rms {np.sqrt((residuals**2).sum(1).mean()):.3f} px"
    cv2.rectangle(canvas, (0, 0), (16 * len(said), 40), (0, 0, 0), -1)
    cv2.putText(canvas, said, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)
    return canvas
