"""Drawing of the epipolar geometry of two images, side by side."""

import colorsys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.pipeline.inputs.photo import Photo
from omnisight.pipeline.two_views.epipolar import EpipolarResult
from omnisight.report.drawings.canvas import GREEN, RED, WHITE, Color, ImageCanvas, write_text
from omnisight.twoview.epipolar_curves import epipolar_curve, epipoles

Array = NDArray[np.float64]

# Largest height of an image and width of both.
MAX_HEIGHT_PX, MAX_WIDTH_PX = 1000, 2600
# Brightness of the images below the drawing.
BRIGHTNESS = 0.55
# Inliers whose epipolar curves are drawn, one per sector of epipolar planes.
MAX_CURVES = 12
# Heights and widths of the gap between the images, and of a line of text.
GAP_PX, LINE_PX = 12, 30
BLACK = (0, 0, 0)


def draw_epipolar(result: EpipolarResult) -> NDArray[np.uint8]:
    """Draw both images with matches, epipolar curves and epipoles.

    Inliers are green and other matches red. Some inliers have the same colour and number in both images, where their
    epipolar curves are drawn. A circle with a cross is the direction to the centre of the other camera, a circle with
    a dot the opposite direction. A rotation only has neither curves nor epipoles.

    Returns
    -------
    (H, W, 3) RGB image.

    Raises
    ------
    ValueError
        If the result has no pose.
    """
    b_from_a = result.b_from_a
    if b_from_a is None:
        raise ValueError(f"there is no epipolar geometry to draw: {result.reason}")
    matched, inliers = result.matched, result.pose.inliers
    selected = _spread_over_planes(matched[1].bearings, b_from_a, inliers)
    canvases: list[ImageCanvas] = []
    poses = (b_from_a.inverse(), b_from_a)
    for side, (photo, zoom) in enumerate(zip(result.photos, _zooms(result.photos), strict=True)):
        canvas = ImageCanvas(photo.image, zoom, gray=True, brightness=BRIGHTNESS)
        canvas.dots(matched[side].pixels[~inliers], RED)
        canvas.dots(matched[side].pixels[inliers], GREEN)
        others = matched[1 - side].bearings[selected]
        for number, (pixel, bearing) in enumerate(zip(matched[side].pixels[selected], others, strict=True)):
            color = _color(number, len(selected))
            for piece in epipolar_curve(photo.camera, poses[side], bearing) if result.has_translation else []:
                canvas.polyline(piece, color, 2)
            _draw_numbered(canvas, pixel, number + 1, color)
        if result.has_translation:
            _draw_epipoles(canvas, photo, poses[side])
        canvases.append(canvas)
    return _side_by_side(canvases, _caption(result))


def _spread_over_planes(bearings_b: Array, b_from_a: Pose, inliers: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the strongest inlier of each of several sectors of epipolar planes, which are planes through the baseline.

    The sectors divide the angles at which there are inliers: all around, or beside the largest gap. Those of a rotation
    only are about the z axis.
    """
    rows = np.flatnonzero(inliers)
    t = b_from_a.translation if b_from_a.translation.any() else np.array([0.0, 0.0, 1.0])
    first = np.cross(t, np.eye(3)[np.abs(t).argmin()])
    angle = np.arctan2(bearings_b[rows] @ np.cross(t, first), bearings_b[rows] @ first)
    ordered = np.sort(angle)
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    from_gap = (angle - ordered[(gaps.argmax() + 1) % len(ordered)]) % (2 * np.pi)
    sector = np.floor(from_gap / (2 * np.pi - gaps.max() + 1e-9) * MAX_CURVES)
    _, strongest = np.unique(sector, return_index=True)
    return rows[strongest]


def _zooms(photos: tuple[Photo, Photo]) -> tuple[float, float]:
    """Return the zooms at which both images have one height."""
    ratios = [photo.camera.width / photo.camera.height for photo in photos]
    height = min(MAX_HEIGHT_PX, MAX_WIDTH_PX / sum(ratios))
    return height / photos[0].camera.height, height / photos[1].camera.height


def _color(number: int, count: int) -> Color:
    """Return one of `count` colours that differ in hue; neighbours differ in brightness too."""
    red, green, blue = colorsys.hls_to_rgb(number / count, (0.55, 0.72)[number % 2], 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def _draw_numbered(canvas: ImageCanvas, pixel: Array, number: int, color: Color) -> None:
    """Draw a large dot with a number."""
    import cv2

    u, v = canvas.positions(pixel)
    cv2.circle(canvas.pixels, (u, v), 7 * 16, BLACK, -1, cv2.LINE_AA, 4)
    cv2.circle(canvas.pixels, (u, v), 5 * 16, color, -1, cv2.LINE_AA, 4)
    _write_outlined(canvas.pixels, str(number), (u // 16 + 9, v // 16 - 7), color)


def _draw_epipoles(canvas: ImageCanvas, photo: Photo, cam_from_other: Pose) -> None:
    """Draw the epipoles that lie in the image: with a cross to the other camera, with a dot the opposite one."""
    import cv2

    pixels, visible = epipoles(photo.camera, cam_from_other)
    for pixel, name in zip(pixels[visible], np.array(["e", "-e"])[visible], strict=True):
        u, v = canvas.positions(pixel)
        for color, width in ((BLACK, 5), (WHITE, 2)):
            cv2.circle(canvas.pixels, (u, v), 13 * 16, color, width, cv2.LINE_AA, 4)
            if name == "e":
                for du, dv in ((9 * 16, 0), (0, 9 * 16)):
                    cv2.line(canvas.pixels, (u - du, v - dv), (u + du, v + dv), color, width, cv2.LINE_AA, 4)
            else:
                cv2.circle(canvas.pixels, (u, v), width * 16, color, -1, cv2.LINE_AA, 4)
        _write_outlined(canvas.pixels, name, (u // 16 + 18, v // 16 + 7), WHITE)


def _write_outlined(pixels: Any, text: str, position: tuple[int, int], color: Color) -> None:
    """Write text that is readable on any background."""
    write_text(pixels, text, position, 0.7, BLACK, 5)
    write_text(pixels, text, position, 0.7, color, 2)


def _caption(result: EpipolarResult) -> list[str]:
    inliers = int(result.pose.inliers.sum())
    return [
        f"{len(result.matches)} matches, {inliers} inliers (green); {result.motion.name}; parallax"
        f" {result.parallax_deg:.2f} deg, residual {result.median_residual_deg:.3f} deg (medians)",
        "one colour: a match and its epipolar curves; e: direction to the other camera, -e: opposite direction",
    ]


def _side_by_side(canvases: list[ImageCanvas], caption: list[str]) -> NDArray[np.uint8]:
    """Return both images below a caption, whose size fits the width."""
    import cv2

    height = max(canvas.pixels.shape[0] for canvas in canvases)
    width = sum(canvas.pixels.shape[1] for canvas in canvases) + GAP_PX
    longest = max(cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)[0][0] for line in caption)
    size = min(0.8, (width - 2 * GAP_PX) / longest)
    top = len(caption) * LINE_PX + GAP_PX
    page = np.full((top + height, width, 3), 24, np.uint8)
    for row, line in enumerate(caption):
        write_text(page, line, (GAP_PX, (row + 1) * LINE_PX - 6), size)
    left = 0
    for canvas in canvases:
        page[top : top + canvas.pixels.shape[0], left : left + canvas.pixels.shape[1]] = canvas.pixels
        left += canvas.pixels.shape[1] + GAP_PX
    return page
