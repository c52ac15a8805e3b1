"""Masks: images that are white where pixels are used."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images.gray import to_gray8
from omnisight.images.read import read_bytes, read_image


def read_mask(path: str | Path, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Read the mask (H, W) of the pixels to use: white ones, or those that are set in a PBM file.

    Raises
    ------
    ValueError
        If the file is not an image of the size (width, height).
    """
    gray = to_gray8(read_image(path))
    if gray.shape[::-1] != size:
        raise ValueError(
            f"{path}: is {gray.shape[1]} x {gray.shape[0]} px, and must have the size of the image or view that it"
            f" masks, {size[0]} x {size[1]} px"
        )
    # A PBM bitmap stores black on white: its set pixels decode as black.
    return gray < 128 if read_bytes(path)[:2] in (b"P1", b"P4") else gray > 127


def masked_region(region: NDArray[np.bool_], mask: NDArray[np.bool_] | None, camera: str = "") -> NDArray[np.bool_]:
    """Return the pixels of a region (H, W) that a mask selects, of the camera of a name; all without a mask.

    Raises
    ------
    ValueError
        If there are none.
    """
    used = region if mask is None else region & mask
    if not used.any():
        of = f" of {camera}" if camera else ""
        raise ValueError(f"the mask{of} selects no pixel of the field of view: use white for usable pixels")
    return used
