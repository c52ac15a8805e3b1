"""Luma and chroma planes of video frames (4:2:0): read and written without conversion to RGB."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Plane = NDArray[Any]

# Formats of FFmpeg whose planes are used as they are, with their bits.
PLANAR = {"yuv420p": 8, "yuvj420p": 8, "yuv420p10le": 10}
FORMATS = {8: "yuv420p", 10: "yuv420p10le"}
# Value of FFmpeg's AVColorRange for luma from 0 to 255.
FULL = 2
# Luma of black of 8 bits in the limited range.
BLACK = 16


@dataclass(frozen=True, eq=False)
class Yuv:
    """A frame of one luma and two chroma planes of half its size.

    Attributes
    ----------
    frame
        The frame of PyAV, whose memory the planes are.
    size
        (width, height) px, even.
    depth
        Bits of a channel, 8 or 10.
    is_full_range
        Whether black is 0, and not 16 of 255.
    """

    frame: Any
    size: tuple[int, int]
    depth: int
    is_full_range: bool

    @classmethod
    def of(cls, frame: Any, depth: int) -> "Yuv":
        """Return a decoded frame, converted if its format has other planes or another depth."""
        is_full_range = frame.color_range == FULL or frame.format.name.startswith("yuvj")
        if PLANAR.get(frame.format.name) != depth:
            frame = frame.reformat(format=FORMATS[depth])
        return cls(frame, (frame.width, frame.height), depth, is_full_range)

    @classmethod
    def empty(cls, size: tuple[int, int], like: "Yuv") -> "Yuv":
        """Return a frame of a size, whose planes are to be written, with the colours of another frame."""
        import av

        frame: Any = av.VideoFrame(*size, FORMATS[like.depth])
        for name in ("color_range", "colorspace", "color_primaries", "color_trc"):
            setattr(frame, name, getattr(like.frame, name))
        if like.is_full_range:
            frame.color_range = FULL
        return cls(frame, size, like.depth, like.is_full_range)

    @property
    def black(self) -> tuple[int, int]:
        """Values of luma and chroma of a black pixel."""
        scale = 2 ** (self.depth - 8)
        return (0 if self.is_full_range else BLACK) * scale, 128 * scale

    @property
    def planes(self) -> tuple[Plane, Plane, Plane]:
        """The three planes (H, S): rows of S >= W pixels, of which the first W are the image."""
        luma, first, second = (_rows(plane, self.depth) for plane in self.frame.planes[:3])
        return luma, first, second


def _rows(plane: Any, depth: int) -> Plane:
    pixels = np.frombuffer(plane, np.uint8 if depth == 8 else np.uint16)
    return pixels[: plane.height * (len(pixels) // plane.height)].reshape(plane.height, -1)


def rotated(yuv: Yuv, degrees: int) -> Yuv:
    """Return a frame rotated clockwise by a multiple of 90 degrees."""
    if degrees % 360 == 0:
        return yuv
    width, height = yuv.size
    turned = Yuv.empty((height, width) if degrees % 180 else (width, height), yuv)
    for k, (source, target) in enumerate(zip(yuv.planes, turned.planes, strict=True)):
        width, height = (n if k == 0 else (n + 1) // 2 for n in yuv.size)
        image = np.rot90(source[:height, :width], -degrees // 90)
        target[: image.shape[0], : image.shape[1]] = image
    return turned
