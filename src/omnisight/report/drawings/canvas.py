"""An image resized for display, on which drawings are made in pixel coordinates of the original image."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omnisight.images import ImageField, to_gray8

Color = tuple[int, int, int]

GREEN, RED, YELLOW, BLUE, WHITE = (60, 220, 60), (255, 60, 60), (255, 220, 0), (80, 160, 255), (255, 255, 255)
# Longer side at which images are drawn: enough to judge corners, and not much more than a screen shows.
DRAWING_SIZE_PX = 1600
# Level of the background where the image itself is missing.
BLANK_LEVEL = np.uint8(40)
# Points along the boundary of an image field.
OUTLINE_POINTS = 240


class ImageCanvas:
    """An RGB image with drawing functions; all positions are pixels of the original image."""

    def __init__(self, image: Any, zoom: float, *, gray: bool = False, brightness: float = 1.0) -> None:
        import cv2

        interpolation = cv2.INTER_CUBIC if zoom > 1 else cv2.INTER_AREA
        rgb = _gray_rgb(image) if gray else _rgb(image)
        self.zoom = zoom
        self.pixels = cv2.resize(rgb, None, fx=zoom, fy=zoom, interpolation=interpolation)
        if brightness != 1:
            self.pixels = (brightness * self.pixels).astype(np.uint8)
        self.line_width = max(1, round(max(self.pixels.shape[:2]) / DRAWING_SIZE_PX))

    def positions(self, pixels: ArrayLike) -> Any:
        """Return pixels as canvas positions in 1/16 px, the fixed-point format of OpenCV with shift=4."""
        return np.rint(((np.asarray(pixels) + 0.5) * self.zoom - 0.5) * 16).astype(np.int32)

    def polyline(self, pixels: ArrayLike, color: Color, width: int | None = None) -> None:
        """Draw a line through pixels (N, 2)."""
        import cv2

        cv2.polylines(self.pixels, [self.positions(pixels)], False, color, width or self.line_width, cv2.LINE_AA, 4)

    def ellipse(self, pixel: ArrayLike, semi_axes: Any, angle_deg: float, color: Color) -> None:
        """Draw an ellipse, at least three line widths large."""
        import cv2

        axes = np.maximum(np.rint(semi_axes * self.zoom * 16), 48 * self.line_width).astype(int)
        style = color, self.line_width, cv2.LINE_AA, 4
        cv2.ellipse(self.pixels, self.positions(pixel), axes, angle_deg, 0, 360, *style)

    def square(self, pixel: ArrayLike, color: Color) -> None:
        """Draw a square marker around a pixel."""
        import cv2

        position, half = self.positions(pixel), 160 * self.line_width
        cv2.rectangle(self.pixels, position - half, position + half, color, self.line_width, cv2.LINE_AA, 4)

    def dots(self, pixels: ArrayLike, color: Color) -> None:
        """Draw a filled dot at each pixel."""
        import cv2

        for position in self.positions(pixels):
            cv2.circle(self.pixels, position, 2 * 16, color, -1, cv2.LINE_AA, 4)

    def field(self, field: ImageField | None, color: Color) -> None:
        """Draw the boundaries of an image field."""
        for boundary in () if field is None else (field.outer, field.inner):
            if boundary is not None:
                outline = boundary.outline(OUTLINE_POINTS)
                self.polyline([*outline, outline[0]], color)

    def caption(self, text: str) -> None:
        """Write a caption in the upper left corner."""
        import cv2

        cv2.rectangle(self.pixels, (0, 0), (16 * len(text), 40), (0, 0, 0), -1)
        write_text(self.pixels, text, (12, 28), 0.8)


def display_zoom(size: tuple[int, int]) -> float:
    """Return the zoom at which an image of a size (width, height) is displayed: an integer if it is enlarged."""
    longer = max(size)
    return (
        float(np.ceil(DRAWING_SIZE_PX / longer)) if longer < DRAWING_SIZE_PX else min(1.0, 2 * DRAWING_SIZE_PX / longer)
    )


def blank_image(size: tuple[int, int], level: np.uint8 = BLANK_LEVEL) -> Any:
    """Return a uniform gray image of a size (width, height)."""
    return np.full(size[::-1], level)


def write_text(
    pixels: Any, text: str, position: tuple[int, int], size: float, color: Color = WHITE, width: int = 1
) -> None:
    """Write text into an image, with its lower left corner at `position`."""
    import cv2

    cv2.putText(pixels, text, position, cv2.FONT_HERSHEY_SIMPLEX, size, color, width, cv2.LINE_AA)


def _rgb(image: Any) -> Any:
    if image.ndim == 3 and image.dtype == np.uint8:
        return np.ascontiguousarray(image[..., :3])
    return _gray_rgb(image)


def _gray_rgb(image: Any) -> Any:
    import cv2

    return cv2.cvtColor(to_gray8(image), cv2.COLOR_GRAY2RGB)
