"""Images with what was found drawn in."""

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.images import read_image, to_gray8, write_image
from omnisight.images.output_paths import drawing_paths
from omnisight.targets import Detection, Detections, ImageDetection, PointTarget

BARE = np.uint8(40)
GREEN, RED, YELLOW, BLUE = (60, 220, 60), (255, 60, 60), (255, 220, 0), (80, 160, 255)
WIDE = 1600  # px; images are drawn about so large
MAGNIFIED = 100  # standard deviations
# A residual is drawn this many times longer than it is.
EXAGGERATION = 50


def draw_residuals(
    search: Detections,
    pixels: Any,
    residuals: Any,
    doubtful: Any,
    folder: Path,
    *,
    apply_exif: bool = False,
) -> str:
    """Draw corners, their order and their residuals (50 times longer than they are) into a copy of every image.

    Residuals (N, 2) of corners (N, 2) are in the order of the search. Give what to say of corners that were given
    without their image: those are drawn on a bare sheet.
    """
    files = drawing_paths([picture.path for picture in search.found], folder)
    folder.mkdir(parents=True, exist_ok=True)
    bare = 0
    for picture, rows, file in zip(search.found, rows_of_pictures(search), files, strict=True):
        without = isinstance(search.board, PointTarget) and not picture.path.is_file()
        bare += without
        sheet = _Sheet(picture, apply_exif, bare=without)
        for detection in picture.boards:
            sheet.rows(detection, search)
        for p, r, bad in zip(pixels[rows], residuals[rows], doubtful[rows], strict=True):
            color = RED if bad else GREEN
            sheet.ellipse(p, np.zeros(2), 0.0, color)
            if np.isfinite(r).all():
                sheet.line([p, p + EXAGGERATION * r], color)
        known = np.isfinite(residuals[rows]).all(1)
        rms = np.sqrt((residuals[rows][known] ** 2).sum(1).mean()) if known.any() else np.nan
        sheet.label(f"residuals x{EXAGGERATION}, rms {rms:.3f} px")
        write_image(file, sheet.canvas)
    return f" ({bare} on a bare sheet: their images do not lie beside the corners)" if bare else ""


def draw_boards(
    search: Detections,
    files: Sequence[Path],
    *,
    apply_exif: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Draw every image that could be read with its corners, row by row, and the border of what the lens shows.

    The first point has a square around it; ellipses are a standard deviation, magnified.
    """
    if files:
        files[0].parent.mkdir(parents=True, exist_ok=True)
    for i, (picture, file) in enumerate(zip(search.images, files, strict=True)):
        if picture.size is not None:
            write_image(file, _drawn(picture, search, apply_exif))
        if progress is not None:
            progress(i + 1, len(files))


def _drawn(picture: ImageDetection, search: Detections, apply_exif: bool) -> Any:
    sheet = _Sheet(picture, apply_exif)
    shown = search.field
    for border in () if shown is None else (shown.outer, shown.inner):
        if border is not None:
            sheet.line([*border.outline(180), border.outline(180)[0]], BLUE)
    for detection in picture.boards:
        sheet.rows(detection, search)
        inside = np.ones(len(detection), bool) if shown is None else shown.contains(detection.pixels)
        for p, covariance, good in zip(detection.pixels, detection.covariance, inside, strict=True):
            size, axes = np.linalg.eigh(covariance)
            angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
            sheet.ellipse(p, MAGNIFIED * np.sqrt(size[::-1]), angle, GREEN if good else RED)
        sheet.square(detection.pixels[0], RED)
    corners = sum(map(len, picture.boards))
    sheet.label(f"{search.board}: {corners} corners, ellipses {MAGNIFIED} sigma" if corners else picture.note)
    return sheet.canvas


def rows_of_pictures(search: Detections) -> list[slice]:
    """Give the rows of `Observations` that each image with a board has."""
    ends = list(accumulate((sum(map(len, picture.boards)) for picture in search.found), initial=0))
    return [slice(start, stop) for start, stop in pairwise(ends)]


class _Sheet:
    """An image, enlarged where it is small, to draw on; places are pixels of the image."""

    def __init__(self, picture: ImageDetection, apply_exif: bool, *, bare: bool = False) -> None:
        import cv2

        width, height = picture.size or (1, 1)
        image = np.full((height, width, 3), BARE) if bare else _as_rgb(read_image(picture.path, apply_exif=apply_exif))
        longer = max(image.shape[:2])
        # Large enough to judge, and no larger than a screen shows.
        self.zoom = float(np.ceil(WIDE / longer)) if longer < WIDE else min(1.0, 2 * WIDE / longer)
        how = cv2.INTER_CUBIC if self.zoom > 1 else cv2.INTER_AREA
        self.canvas = cv2.resize(image, None, fx=self.zoom, fy=self.zoom, interpolation=how)
        self.thick = max(1, round(max(self.canvas.shape[:2]) / WIDE))

    def line(self, pixels: Any, color: tuple[int, int, int]) -> None:
        import cv2

        cv2.polylines(self.canvas, [self._at(pixels)], False, color, self.thick, cv2.LINE_AA, 4)

    def rows(self, detection: Detection, search: Detections) -> None:
        """Join the points of each row of the board."""
        columns = getattr(search.board, "columns", 1)  # a target that was given has no rows
        for row in np.unique(detection.ids // columns):
            self.line(detection.pixels[detection.ids // columns == row], YELLOW)

    def ellipse(self, pixel: Any, half: Any, angle_deg: float, color: tuple[int, int, int]) -> None:
        import cv2

        axes = np.maximum(np.rint(half * self.zoom * 16), 48 * self.thick).astype(int)
        cv2.ellipse(self.canvas, self._at(pixel), axes, angle_deg, 0, 360, color, self.thick, cv2.LINE_AA, 4)

    def square(self, pixel: Any, color: tuple[int, int, int]) -> None:
        import cv2

        at, half = self._at(pixel), 160 * self.thick
        cv2.rectangle(self.canvas, at - half, at + half, color, self.thick, cv2.LINE_AA, 4)

    def label(self, said: str) -> None:
        import cv2

        cv2.rectangle(self.canvas, (0, 0), (16 * len(said), 40), (0, 0, 0), -1)
        cv2.putText(self.canvas, said, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 1, cv2.LINE_AA)

    def _at(self, pixels: Any) -> Any:
        """Give places on the canvas in sixteenths of its pixels, as cv2 wants with shift=4."""
        return np.rint(((np.asarray(pixels) + 0.5) * self.zoom - 0.5) * 16).astype(np.int32)


def _as_rgb(image: Any) -> Any:
    import cv2

    if image.ndim == 3 and image.dtype == np.uint8:
        return np.ascontiguousarray(image[..., :3])
    return cv2.cvtColor(to_gray8(image), cv2.COLOR_GRAY2RGB)
