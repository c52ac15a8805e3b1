"""Where a lens or a mirror shows anything: the image circle of a fisheye, the two borders of a mirror."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._border import find_border, find_hole
from .ellipse import Ellipse

_PIXELS = 1_000_000  # what is looked at; averaging down keeps a border's sub-pixel position
_LEAST_SIDE = 32


@dataclass(frozen=True)
class ImageField:
    """The part of a camera's pictures that shows anything.

    Parameters
    ----------
    size : (width, height) px
    outer : Ellipse or None
        Border beyond which all is dark, at half height; None where none is seen, the lens then fills the picture.
    inner : Ellipse or None
        Border within which a mirror shows its hole, its holder or the camera; None where none is seen.
    outer_fade, inner_fade : float
        Px beyond the border, into the dark, until all is dark: the rim of many a lens is soft, and what lies there
        is dim but can be seen.
    """

    size: tuple[int, int]
    outer: Ellipse | None = None
    inner: Ellipse | None = None
    outer_fade: float = 0.0
    inner_fade: float = 0.0

    def contains(self, pixels: ArrayLike, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Tell which pixels (..., 2) show anything.

        Parameters
        ----------
        pixels : (..., 2) array
            (u, v); NaN and what lies outside the picture is False.
        margin_px : float
            Stay that far away from where the lens or mirror has faded to dark, or reach beyond that where
            negative. The picture's own edges have no margin.
        """
        pixels = np.asarray(pixels, float)
        shown = ((pixels >= -0.5) & (pixels <= np.array(self.size) - 0.5)).all(axis=-1)
        if self.outer is not None:
            shown = shown & self.outer.grown(self.outer_fade - margin_px).contains(pixels)
        if self.inner is not None:
            shown = shown & ~self.inner.grown(margin_px - self.inner_fade).contains(pixels)
        return np.asarray(shown)

    def resized(self, size: tuple[int, int]) -> ImageField:
        """Give it for the same pictures in another size (width, height) px."""
        scale = np.array(size) / np.array(self.size)
        return ImageField(
            size,
            self.outer and _scaled(self.outer, scale),
            self.inner and _scaled(self.inner, scale),
            self.outer_fade * float(scale.mean()),
            self.inner_fade * float(scale.mean()),
        )

    def describe(self) -> str:
        """Say in one sentence what was found."""
        if self.outer is None:
            return "no border seen: the lens fills the picture"
        u, v = self.outer.centre
        a, b = self.outer.axes
        if self.inner is not None:
            what = f"mirror between radius {self.inner.radius:.0f} and {self.outer.radius:.0f} px"
        elif max(a, b) < 1.03 * min(a, b):
            what = f"image circle of radius {self.outer.radius:.0f} px"
        else:
            what = f"image ellipse of half-axes {a:.0f} and {b:.0f} px"
        soft = f", fading over {self.outer_fade:.0f} px" if self.outer_fade > 0.03 * self.outer.radius else ""
        sides = _cut_sides(self.outer, self.size)
        cut = " and ".join(filter(None, (", ".join(sides[:-1]), *sides[-1:])))
        return f"{what} around ({u:.0f}, {v:.0f}){soft}" + (f", cut by the picture {cut}" if cut else "")


def _cut_sides(border: Ellipse, size: tuple[int, int]) -> list[str]:
    """List the sides of the picture beyond which a border reaches by a pixel or more."""
    reach = np.linalg.norm(border.matrix, axis=1)
    left, above = np.array(border.centre) - reach < -1.5
    right, below = np.array(border.centre) + reach > np.array(size) + 0.5
    cut = {"above": above, "below": below, "left": left, "right": right}
    return ["on all sides"] if all(cut.values()) else [side for side, beyond in cut.items() if beyond]


def estimate_field(pictures: Iterable[NDArray[np.uint8]]) -> ImageField:
    """Find where a camera's pictures show anything.

    A border stands still while the scene changes, so the brightest that each pixel has seen is looked at: there
    the scene's own edges fade. One picture may do; many are surer. Where in doubt no border is given.

    Parameters
    ----------
    pictures : iterable of (H, W) arrays of uint8
        Gray pictures of one camera, taken one by one; memory does not grow with their number.

    Returns
    -------
    ImageField
        Borders at half height between bright and dark, in px of the given pictures.

    Raises
    ------
    ValueError
        If there is no picture, or they differ in size, or are not gray 8-bit pictures.
    """
    bright, (width, height) = _brightest(pictures)
    h, w = bright.shape
    if min(h, w) < _LEAST_SIDE:
        return ImageField((width, height))
    outer = find_border(bright, (0.25 * min(h, w), 0.65 * float(np.hypot(h, w))))
    inner = outer and find_hole(bright, outer.ellipse)
    field = ImageField(
        (w, h),
        outer and outer.ellipse,
        inner and inner.ellipse,
        outer.fade if outer else 0.0,
        inner.fade if inner else 0.0,
    )
    return field.resized((width, height))


def _scaled(ellipse: Ellipse, scale: NDArray[np.float64]) -> Ellipse:
    return Ellipse.from_matrix((np.array(ellipse.centre) + 0.5) * scale - 0.5, scale[:, None] * ellipse.matrix)


def _brightest(pictures: Iterable[NDArray[np.uint8]]) -> tuple[NDArray[np.uint8], tuple[int, int]]:
    """Give the brightest (from three pictures on: the second brightest) value of each pixel, and the pictures' size.

    The second, for one flare, or one hand before the lens' rim, must not light up what is dark else.
    """
    first = second = np.zeros((0, 0), np.uint8)
    size, count = (0, 0), 0
    for picture in pictures:
        if picture.ndim != 2 or picture.dtype != np.uint8 or picture.size == 0:
            raise ValueError(f"expected gray pictures (H, W) of uint8, got {picture.dtype} of shape {picture.shape}")
        h, w = picture.shape
        small = shrunk(picture)
        if count == 0:
            size, first, second = (w, h), small, np.zeros_like(small)
        elif size != (w, h):
            raise ValueError(f"expected pictures of one size, got {size[0]} x {size[1]} and {w} x {h}")
        else:
            second = np.maximum(second, np.minimum(first, small))
            first = np.maximum(first, small)
        count += 1
    if count == 0:
        raise ValueError("expected at least one picture, got none")
    return (second if count > 2 else first), size


def shrunk(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Average a gray picture down to what `estimate_field` looks at: its result is the same but for the size."""
    import cv2

    h, w = picture.shape
    shrink = max(1.0, (h * w / _PIXELS) ** 0.5)
    if shrink == 1:
        return picture
    size = (max(1, round(w / shrink)), max(1, round(h / shrink)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
