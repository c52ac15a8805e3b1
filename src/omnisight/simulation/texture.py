"""Images that faces show, in sizes from whole to one pixel, so that none is ever shown finer than it is looked at."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]


def to_linear(display: NDArray[Any]) -> Floats:
    """Give the light (0 to 1) of display values 0 to 1: sRGB's curve (IEC 61966-2-1)."""
    v = np.asarray(display, np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_display(light: NDArray[Any]) -> Floats:
    """Give the display values, 0 to 1, of light; what is brighter than 1 stays 1."""
    v = np.clip(light, 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** np.float32(1 / 2.4) - 0.055).astype(
        np.float32
    )


LINEAR = to_linear(np.arange(256) / 255)


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on a face.

    Attributes
    ----------
    image
        (h, w, 3) uint8 RGB in sRGB, u to the right and v down.
    """

    picture: Bytes

    @classmethod
    def plain(cls, colour: tuple[int, int, int]) -> "Texture":
        """Give one colour."""
        return cls(np.full((1, 1, 3), colour, np.uint8))

    @cached_property
    def levels(self) -> list[Bytes]:
        """The image, and each half as large as the one before, averaged in light; the last has a side of 1."""
        import cv2

        levels = [np.ascontiguousarray(self.picture)]
        light = LINEAR[self.picture]
        while min(light.shape[:2]) > 1:
            half = (max(light.shape[1] // 2, 1), max(light.shape[0] // 2, 1))
            light = np.asarray(cv2.resize(light, half, interpolation=cv2.INTER_AREA), np.float32)
            levels.append(np.rint(255 * to_display(light)).astype(np.uint8))
        return levels
