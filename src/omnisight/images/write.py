"""Writes pictures so that a file is either the old one or the whole new one."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DEEP = frozenset({".png", ".tif", ".tiff", ".pgm", ".ppm", ".pnm"})
_WITH_ALPHA = frozenset({".png", ".tif", ".tiff", ".webp"})
_WRITABLE = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm")


def write_image(path: str | Path, image: NDArray[Any]) -> None:
    """Write a picture in the format that the extension names.

    Parameters
    ----------
    path : str or Path
        In a folder that exists.
    image : (H, W), (H, W, 3) or (H, W, 4) array of uint8 or uint16
        Gray, RGB or RGBA.

    Raises
    ------
    ValueError
        If the extension, the shape or the depth cannot be written.
    OSError
        If the folder is missing or not writable.
    """
    import cv2

    path = Path(path)
    extension = path.suffix.lower()
    if extension not in _WRITABLE:
        known = " ".join(e[1:] for e in _WRITABLE)
        raise ValueError(f"{path.name}: cannot write extension {path.suffix!r}. Supported: {known}")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)) or image.size == 0:
        raise ValueError(f"expected an image (H, W), (H, W, 3) or (H, W, 4), got shape {image.shape}")
    if image.dtype.name not in ("uint8", "uint16"):
        raise ValueError(f"expected an image of uint8 or uint16, got {image.dtype}")
    if image.dtype == np.uint16 and extension not in _DEEP:
        raise ValueError(f"{path.name}: {extension[1:]} holds 8 bits per channel; use png or tif for 16")
    if image.ndim == 3 and image.shape[2] == 4 and extension not in _WITH_ALPHA:
        raise ValueError(f"{path.name}: {extension[1:]} holds no transparency; use png, tif or webp")
    if extension == ".pgm" and image.ndim == 3:
        raise ValueError(f"{path.name}: pgm holds gray pictures only; use ppm or png")
    channels = image if image.ndim == 2 else image[:, :, [2, 1, 0, 3][: image.shape[2]]]
    done, encoded = cv2.imencode(extension, np.ascontiguousarray(channels))
    if not done:
        raise ValueError(f"{path.name}: OpenCV could not encode shape {image.shape} as {extension[1:]}")
    write_bytes(path, encoded.tobytes())


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file atomically: into a temporary file beside it, then renamed over it.

    Raises
    ------
    OSError
        If the folder is missing (`FileNotFoundError`) or the file cannot be written there; the temporary file
        is gone then.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: the folder {path.parent} does not exist")
    # Not tempfile: its files are private to the user, and the result would stay so.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(4).hex()}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        raise type(error)(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)
