"""Reads a picture file into an array, or says in one line why it cannot."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .headers import JPEG_MAGIC, PNG_MAGIC, declared_size, exif_orientation, jpeg_fault, png_fault

MAX_PIXELS = 10**9

_quiet = threading.Lock()


class UnreadableImage(ValueError):
    """A file that gives no picture; its text names the file and what was found in it."""


def read_image(path: str | Path, *, apply_exif: bool = False) -> NDArray[Any]:
    """Read a picture.

    Parameters
    ----------
    path : str or Path
        The content decides about the format, not the extension.
    apply_exif : bool
        Turn the picture upright by its EXIF orientation. Off by default: the sensor does not turn with the
        camera, and a calibration belongs to the sensor.

    Returns
    -------
    (H, W), (H, W, 3) or (H, W, 4) array of uint8, uint16 or float
        Gray, RGB or RGBA, in the file's own depth.

    Raises
    ------
    UnreadableImage
        If the file is missing, empty, no picture, truncated, damaged or past a gigapixel.
    """
    return decode_image(read_bytes(path), Path(path).name, apply_exif=apply_exif)


def read_bytes(path: str | Path) -> bytes:
    """Read a file whole; `UnreadableImage` says why it cannot be read."""
    path = Path(path)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise UnreadableImage(f"{path}: no such file") from None
    except IsADirectoryError:
        raise UnreadableImage(f"{path}: a folder, not an image") from None
    except OSError as error:
        raise UnreadableImage(f"{path}: {error.strerror or error}") from None


def decode_image(data: bytes, name: str, *, apply_exif: bool = False) -> NDArray[Any]:
    """Decode the bytes of a picture file; `name` stands in error messages. Otherwise as `read_image`."""
    fault = _fault(data)
    if fault is not None:
        raise UnreadableImage(f"{name}: {fault}")
    image = _decode(data)
    if image is None:
        raise UnreadableImage(f"{name}: {_unreadable_kind(data)}")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    elif image.ndim == 3:
        image = image[:, :, [2, 1, 0, 3][: image.shape[2]]]
    if apply_exif:
        image = upright(image, exif_orientation(data))
    return np.ascontiguousarray(image)


def upright(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Turn (H, W, ...) as the EXIF orientation 1 to 8 asks; orientations 5 to 8 swap width and height."""
    if orientation in (5, 6, 7, 8):
        image = np.swapaxes(image, 0, 1)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return image


def _fault(data: bytes) -> str | None:
    if not data:
        return "empty file"
    size = declared_size(data)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        return f"{size[0]} x {size[1]} pixels declared, more than the {MAX_PIXELS:.0e} that are read"
    if data.startswith(JPEG_MAGIC):
        return jpeg_fault(data)
    if data.startswith(PNG_MAGIC):
        return png_fault(data)
    return None


def _decode(data: bytes) -> NDArray[Any] | None:
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    # IMREAD_UNCHANGED keeps depth and alpha, and is the one flag under which OpenCV leaves EXIF alone.
    flag = cv2.IMREAD_UNCHANGED
    try:
        if data.startswith((JPEG_MAGIC, PNG_MAGIC)):
            return cv2.imdecode(buffer, flag)
        # Of the other formats nothing was checked above. OpenCV logs what it dislikes to the terminal, at a
        # level that belongs to the whole process: change it for one picture at a time, and put it back.
        with _quiet:
            log: Any = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging  # OpenCV 4, OpenCV 5
            level = log.getLogLevel()
            log.setLogLevel(0)
            try:
                return cv2.imdecode(buffer, flag)
            finally:
                log.setLogLevel(level)
    except cv2.error:
        return None


def _unreadable_kind(data: bytes) -> str:
    if data[4:8] == b"ftyp":
        kind = "a HEIC or AVIF picture, which is not read" if data[8:12] in _PHONE_BRANDS else "a film, not an image"
        return f"{kind}: export it as JPEG or PNG"
    if data.startswith(b"version https://git-lfs"):
        return "a Git LFS pointer, not the picture itself: run git lfs pull"
    for magic, kind in _MAGICS.items():
        if data.startswith(magic):
            return f"damaged or unsupported {kind}"
    return f"not an image (starts with {data[:5]!r})"


_PHONE_BRANDS = frozenset({b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1", b"avif", b"avis"})

_MAGICS = {
    JPEG_MAGIC: "JPEG",
    PNG_MAGIC: "PNG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"BM": "BMP",
    b"RIFF": "WebP",
    b"GIF8": "GIF",
    **{b"P%d" % i: "PNM" for i in range(1, 7)},
}
