"""Pictures with what was found drawn in."""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibrate import PicturesCalibration
from omnisight.cli._names import outputs
from omnisight.images import read_image, to_gray8, write_image
from omnisight.targets import BoardSearch, PictureDetection

GREEN, RED, YELLOW, BLUE = (60, 220, 60), (255, 60, 60), (255, 220, 0), (80, 160, 255)
WIDE = 1600  # px; pictures are drawn about so large
MAGNIFIED = 100  # standard deviations
# A residual is drawn this many times longer than it is.
EXAGGERATION = 50


def draw_residuals(result: PicturesCalibration, folder: Path, *, apply_exif: bool = False) -> None:
    """Draw corners, their order and their residuals (50 times longer than they are) into a copy of every picture."""
    folder.mkdir(parents=True, exist_ok=True)
    search, calibration = result.search, result.calibration
    residuals = calibration.state.residuals(calibration.views)
    files = outputs([picture.path for picture in search.found], folder)
    for picture, rows, file in zip(search.found, rows_of_pictures(search), files, strict=True):
        image = _as_rgb(read_image(picture.path, apply_exif=apply_exif))
        zoom = max(1, round(WIDE / image.shape[1]))
        canvas = _draw(image, calibration.views.pixels[rows], residuals[rows], calibration.outliers[rows], zoom)
        write_image(file, canvas)


def draw_boards(
    search: BoardSearch,
    files: Sequence[Path],
    *,
    apply_exif: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Draw every picture that could be read with its corners, a colour per row, and the border of what the lens shows.

    The first point has a square around it; ellipses are 3 standard deviations, magnified.
    """
    if files:
        files[0].parent.mkdir(parents=True, exist_ok=True)
    for i, (picture, file) in enumerate(zip(search.pictures, files, strict=True)):
        if picture.size is not None:
            image = _as_rgb(read_image(picture.path, apply_exif=apply_exif))
            write_image(file, _draw_boards(image, picture, search))
        if progress is not None:
            progress(i + 1, len(files))


def _draw_boards(image: Any, picture: PictureDetection, search: BoardSearch) -> Any:
    import cv2

    zoom = max(1, round(WIDE / image.shape[1]))
    thick = max(1, round(zoom * image.shape[1] / WIDE))
    canvas = cv2.resize(image, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)

    def place(pixels: Any) -> Any:
        return np.rint(((np.asarray(pixels) + 0.5) * zoom - 0.5) * 16).astype(int)  # sixteenths, with shift=4

    shown = search.field
    for border in () if shown is None else (shown.outer, shown.inner):
        if border is not None:
            cv2.polylines(canvas, [place(border.outline(180))], True, BLUE, thick, cv2.LINE_AA, 4)
    for detection in picture.boards:
        columns = getattr(search.board, "columns", 1)
        at = place(detection.pixels)
        for (p, i), (q, j) in pairwise(zip(at, detection.ids, strict=True)):
            cv2.line(
                canvas, tuple(p), tuple(q), YELLOW, thick, cv2.LINE_AA, 4
            ) if i // columns == j // columns else None
        inside = np.ones(len(at), bool) if shown is None else shown.contains(detection.pixels)
        for p, covariance, good in zip(at, detection.covariance, inside, strict=True):
            size, axes = np.linalg.eigh(covariance)
            angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
            half = np.maximum(np.rint(MAGNIFIED * zoom * np.sqrt(size[::-1]) * 16), 48 * thick).astype(int)
            color = GREEN if good else RED
            cv2.ellipse(canvas, tuple(p), tuple(half), angle, 0, 360, color, thick, cv2.LINE_AA, 4)
        first = at[0]
        cv2.rectangle(
            canvas, tuple(first - 10 * thick * 16), tuple(first + 10 * thick * 16), RED, thick, cv2.LINE_AA, 4
        )
    corners = sum(map(len, picture.boards))
    said = f"{search.board}: {corners} corners, ellipses {MAGNIFIED} sigma" if corners else picture.note
    _label(canvas, said)
    return canvas


def _label(canvas: Any, said: str) -> None:
    import cv2

    cv2.rectangle(canvas, (0, 0), (16 * len(said), 40), (0, 0, 0), -1)
    cv2.putText(canvas, said, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)


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
    _label(canvas, said)
    return canvas
