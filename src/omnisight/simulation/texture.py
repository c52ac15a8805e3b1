"""Textures with mipmaps (images at successively halved sizes), which prevent aliasing, and sRGB conversion."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]


def to_linear(display: NDArray[Any]) -> Floats:
    """Decode sRGB values, 0 to 1, to linear light (IEC 61966-2-1)."""
    v = np.asarray(display, np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_display(light: NDArray[Any]) -> Floats:
    """Encode linear light as sRGB values, 0 to 1; light above 1 is clipped."""
    v = np.clip(light, 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** np.float32(1 / 2.4) - 0.055).astype(
        np.float32
    )


LINEAR = to_linear(np.arange(256) / 255)
# The 8-bit value of linear light in steps of 1/65535, which are at most 0.05 levels: much faster than powers.
ENCODED = np.rint(255 * to_display(np.arange(65536) / 65535)).astype(np.uint8)


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on the face of a solid.

    Attributes
    ----------
    image
        (h, w, 3) uint8 RGB in sRGB, u to the right and v down.
    repeat
        Copies of the image to the right and down on the face.
    """

    image: Bytes
    repeat: tuple[int, int] = (1, 1)

    @classmethod
    def plain(cls, colour: tuple[int, int, int]) -> "Texture":
        """Make a texture of one colour."""
        return cls(np.full((1, 1, 3), colour, np.uint8))

    @cached_property
    def levels(self) -> list[Bytes]:
        """The mipmap: the image and its successive reductions by 2, averaged in linear light, down to a side of 1."""
        import cv2

        levels = [np.ascontiguousarray(self.image)]
        light = LINEAR[self.image]
        while min(light.shape[:2]) > 1:
            half = (max(light.shape[1] // 2, 1), max(light.shape[0] // 2, 1))
            light = np.asarray(cv2.resize(light, half, interpolation=cv2.INTER_AREA), np.float32)
            levels.append(ENCODED[np.rint(65535 * light).astype(np.uint16)])
        return levels
