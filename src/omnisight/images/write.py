"""Atomic writing of image files: after a failure the old file is intact."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.array_kinds import to_numpy
from omnisight.images.channel_order import swap_red_and_blue

EXTENSIONS_16_BIT = frozenset({".png", ".tif", ".tiff", ".pgm", ".ppm", ".pnm"})
EXTENSIONS_WITH_ALPHA = frozenset({".png", ".tif", ".tiff", ".webp"})
WRITABLE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm")


def write_image(path: str | Path, image: NDArray[Any]) -> None:
    """Write an image in the format given by the extension.

    Parameters
    ----------
    path : str or Path
        A file in an existing folder.
    image : (H, W), (H, W, 3) or (H, W, 4) array of uint8 or uint16
        Gray, RGB or RGBA; arrays of other libraries, such as PyTorch tensors, too.

    Raises
    ------
    ValueError
        If the extension, the shape or the depth is not supported.
    OSError
        If the folder is missing or not writable.
    """
    path = Path(path)
    write_bytes(path, encode_image(image, path.name))


def check_image_suffix(path: Path) -> None:
    """Raise `ValueError` if the extension of a path is not that of an image that can be written."""
    if path.suffix.lower() not in WRITABLE_EXTENSIONS:
        supported = " ".join(e[1:] for e in WRITABLE_EXTENSIONS)
        if not path.suffix:
            raise ValueError(
                f"{path.name}: has no extension: name an image file, such as {path.name}.png, or make the folder first"
            )
        raise ValueError(f"{path.name}: cannot write extension {path.suffix!r}. Supported: {supported}")


def encode_image(image: NDArray[Any], name: str) -> bytes:
    """Return the bytes of an image file in the format given by the extension of a name; see `write_image`."""
    import cv2

    path = Path(name)
    extension = path.suffix.lower()
    check_image_suffix(path)
    image = np.asarray(to_numpy(image))
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)) or image.size == 0:
        raise ValueError(f"expected an image (H, W), (H, W, 3) or (H, W, 4), got shape {image.shape}")
    if image.dtype.name not in ("uint8", "uint16"):
        raise ValueError(f"expected an image of uint8 or uint16, got {image.dtype}")
    if image.dtype == np.uint16 and extension not in EXTENSIONS_16_BIT:
        raise ValueError(f"{path.name}: {extension[1:]} supports 8 bits per channel; use png or tif for 16")
    if image.ndim == 3 and image.shape[2] == 4 and extension not in EXTENSIONS_WITH_ALPHA:
        raise ValueError(f"{path.name}: {extension[1:]} supports no transparency; use png, tif or webp")
    if extension == ".pgm" and image.ndim == 3:
        raise ValueError(f"{path.name}: pgm supports gray images only; use ppm or png")
    channels = np.ascontiguousarray(image) if image.ndim == 2 else swap_red_and_blue(image)
    success, encoded = cv2.imencode(extension, channels)
    if not success:
        raise ValueError(f"{path.name}: OpenCV could not encode shape {image.shape} as {extension[1:]}")
    return encoded.tobytes()


def write_bytes(path: str | Path, data: bytes) -> None:
    """Write a file atomically: write a temporary file in the same folder and rename it.

    Raises
    ------
    OSError
        If the folder is missing (`FileNotFoundError`) or not writable. The temporary file is removed.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: the folder {path.parent} does not exist")
    # Not tempfile: its files are readable by the user only, and the result would keep these permissions.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(4).hex()}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        raise type(error)(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # a read-only file system refuses to delete a file that does not exist
            temporary.unlink()
