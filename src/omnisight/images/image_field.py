"""The image field of a camera: the image circle of a fisheye, or the annulus of a mirror camera."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.images.boundary import detect_inner_boundary, detect_outer_boundary
from omnisight.images.ellipse import Ellipse

# Pixels of the image that is searched. Averaging down keeps the sub-pixel position of a boundary.
MAX_SEARCH_PIXELS = 1_000_000
# Below this size, px, there are too few pixels per ray to fit a boundary.
MIN_SIDE_PX = 32


@dataclass(frozen=True)
class ImageField(Displayed):
    """The region of a camera's images that the lens or mirror illuminates.

    Parameters
    ----------
    size : (width, height) px
    outer : Ellipse or None
        Outer boundary at half of its contrast; dark outside. None if the lens fills the image.
    inner : Ellipse or None
        Inner boundary of a mirror camera: the hole or holder of the mirror, or the camera itself. None if there is
        none.
    outer_fade, inner_fade : float
        Distance in px from the boundary to full dark. The rim of many lenses is soft; corners there are dim but
        measurable.
    """

    size: tuple[int, int]
    outer: Ellipse | None = None
    inner: Ellipse | None = None
    outer_fade: float = 0.0
    inner_fade: float = 0.0

    def contains(self, pixels: ArrayLike, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Return which pixels are illuminated.

        Parameters
        ----------
        pixels : (..., 2) array
            (u, v). The result is False for NaN and outside the image.
        margin_px : float
            Minimum distance from the faded boundary; negative values extend the field. The sides of the image have
            no margin.
        """
        pixels = np.asarray(pixels, float)
        inside = ((pixels >= -0.5) & (pixels <= np.array(self.size) - 0.5)).all(axis=-1)
        if self.outer is not None:
            inside = inside & self.outer.grown(self.outer_fade - margin_px).contains(pixels)
        if self.inner is not None:
            inside = inside & ~self.inner.grown(margin_px - self.inner_fade).contains(pixels)
        return np.asarray(inside)

    def resized(self, size: tuple[int, int]) -> "ImageField":
        """Return the field of the same images resized to `size` (width, height), px."""
        scale = np.array(size) / np.array(self.size)
        return ImageField(
            size,
            self.outer and _scaled(self.outer, scale),
            self.inner and _scaled(self.inner, scale),
            self.outer_fade * float(scale.mean()),
            self.inner_fade * float(scale.mean()),
        )

    def describe(self) -> str:
        """Return one phrase that describes the field."""
        if self.outer is None:
            return "no image circle detected: the lens fills the image"
        u, v = self.outer.centre
        a, b = self.outer.axes
        if self.inner is not None:
            shape = f"mirror between radius {self.inner.radius:.0f} and {self.outer.radius:.0f} px"
        elif max(a, b) < 1.03 * min(a, b):
            shape = f"image circle of radius {self.outer.radius:.0f} px"
        else:
            shape = f"image ellipse of semi-axes {a:.0f} and {b:.0f} px"
        fade = f", fading over {self.outer_fade:.0f} px" if self.outer_fade > 0.03 * self.outer.radius else ""
        sides = _cropped_sides(self.outer, self.size)
        listed = " and ".join(filter(None, (", ".join(sides[:-1]), *sides[-1:])))
        return f"{shape} centred at ({u:.0f}, {v:.0f}){fade}" + (f", cropped {listed}" if listed else "")


def estimate_image_field(images: Iterable[NDArray[np.uint8]]) -> ImageField:
    """Estimate the image field of a camera from its images.

    The boundary is fixed while the scene changes, so it is detected in the maximum of all images, where edges of the
    scene fade. One image may suffice; several are more reliable. Uncertain boundaries are not returned.

    Parameters
    ----------
    images : iterable of (H, W) arrays of uint8
        Gray images of one camera, read one at a time: memory does not grow with their number.

    Returns
    -------
    ImageField
        Boundaries at half of their contrast, in px of the given images.

    Raises
    ------
    ValueError
        If there is no image, if sizes differ, or if an image is not 8-bit gray.
    """
    brightest, (width, height) = _brightest(images)
    h, w = brightest.shape
    if min(h, w) < MIN_SIDE_PX:
        return ImageField((width, height))
    outer = detect_outer_boundary(brightest, (0.25 * min(h, w), 0.65 * float(np.hypot(h, w))))
    inner = outer and detect_inner_boundary(brightest, outer.ellipse)
    field = ImageField(
        (w, h),
        outer and outer.ellipse,
        inner and inner.ellipse,
        outer.fade_px if outer else 0.0,
        inner.fade_px if inner else 0.0,
    )
    return field.resized((width, height))


def downsample(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average a gray image down to the resolution that `estimate_image_field` uses."""
    import cv2

    h, w = gray.shape
    factor = max(1.0, (h * w / MAX_SEARCH_PIXELS) ** 0.5)
    if factor == 1:
        return gray
    size = (max(1, round(w / factor)), max(1, round(h / factor)))
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)


def _brightest(images: Iterable[NDArray[np.uint8]]) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Return the maximum of all images, downsampled, and their size.

    With three or more images it is the second largest value: a single lens flare must not light up the dark surround.
    """
    first = second = np.zeros((0, 0), np.uint8)
    size, count = (0, 0), 0
    for image in images:
        if image.ndim != 2 or image.dtype != np.uint8 or image.size == 0:
            raise ValueError(f"expected gray images (H, W) of uint8, got {image.dtype} of shape {image.shape}")
        h, w = image.shape
        small = downsample(image)
        if count == 0:
            size, first, second = (w, h), small, np.zeros_like(small)
        elif size != (w, h):
            raise ValueError(f"expected images of one size, got {size[0]} x {size[1]} and {w} x {h}")
        else:
            second = np.maximum(second, np.minimum(first, small))
            first = np.maximum(first, small)
        count += 1
    if count == 0:
        raise ValueError("expected at least one image, got none")
    return (second if count > 2 else first), size


def _scaled(ellipse: Ellipse, scale: NDArray[np.float64]) -> Ellipse:
    return Ellipse.from_matrix((np.array(ellipse.centre) + 0.5) * scale - 0.5, scale[:, None] * ellipse.matrix)


def _cropped_sides(boundary: Ellipse, size: tuple[int, int]) -> list[str]:
    """List the sides of the image that the boundary crosses by one pixel or more."""
    extent = np.linalg.norm(boundary.matrix, axis=1)
    left, above = np.array(boundary.centre) - extent < -1.5
    right, below = np.array(boundary.centre) + extent > np.array(size) + 0.5
    cropped = {"above": above, "below": below, "left": left, "right": right}
    return ["on all sides"] if all(cropped.values()) else [side for side, is_cropped in cropped.items() if is_cropped]
