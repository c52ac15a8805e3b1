"""Reading of image files, with a one-line reason for each file that cannot be read."""

from collections.abc import Generator, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.extensions import file_error
from omnisight.images.channel_order import swap_red_and_blue
from omnisight.images.exif import exif_orientation
from omnisight.images.headers import (
    JPEG_MAGIC,
    PNG_MAGIC,
    declared_size,
    describe_start,
    find_jpeg_defect,
    find_png_defect,
)
from omnisight.images.opencv_log import quiet_opencv

# A declared size above a gigapixel is refused before memory is allocated for it.
MAX_PIXELS = 10**9

# Brands of HEIF files (ISO/IEC 23008-12), the default format of phones.
HEIF_BRANDS = frozenset({b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1", b"avif", b"avis"})
FORMAT_MAGICS = {
    JPEG_MAGIC: "JPEG",
    PNG_MAGIC: "PNG",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"BM": "BMP",
    b"RIFF": "WebP",
    b"GIF8": "GIF",
    **{b"P%d" % i: "PNM" for i in range(1, 7)},
}


class UnreadableImage(ValueError):
    """A file that cannot be read as an image or video; the message names the file and the reason."""


def read_image(path: str | Path, *, apply_exif: bool = False) -> NDArray[Any]:
    """Read an image.

    Parameters
    ----------
    path : str or Path
        The format is determined from the content, not from the extension.
    apply_exif : bool
        Rotate the image upright by its EXIF orientation. Off by default, because a calibration refers to the sensor
        and the sensor does not rotate.

    Returns
    -------
    (H, W), (H, W, 3) or (H, W, 4) array of uint8, uint16 or float
        Gray, RGB or RGBA, in the depth of the file.

    Raises
    ------
    UnreadableImage
        If the file is missing, empty, not an image, truncated, damaged or larger than a gigapixel.
    """
    return decode_image(read_bytes(path), Path(path).name, apply_exif=apply_exif)


def readable_images(paths: Iterable[Path], *, apply_exif: bool = False) -> Generator[tuple[Path, NDArray[Any]]]:
    """Read images one at a time with `read_image`; those that cannot be read are left out.

    Raises
    ------
    UnreadableImage
        If none can be read, with the reason of the first.
    """
    first, has_image = None, False
    for path in paths:
        try:
            image = read_image(path, apply_exif=apply_exif)
        except UnreadableImage as error:
            first = first or error
            continue
        has_image = True
        yield path, image
    if first is not None and not has_image:
        raise first


def unreadable_warnings(reasons: Mapping[str, str], images: int) -> tuple[str, ...]:
    """Return the warning that some of a number of images cannot be used, from their names and reasons."""
    for name, reason in reasons.items():
        return (f"{len(reasons)} of {images} images cannot be used and are left out, the first is {name}: {reason}",)
    return ()


def reason_without_name(error: Exception, path: str | Path) -> str:
    """Return the message of an error of a file without the path or name that it begins with.

    For reasons that are listed by name.
    """
    message = str(error)
    for label in (str(path), Path(path).name):
        message = message.removeprefix(f"{label}: ")
    return message


def read_bytes(path: str | Path) -> bytes:
    """Read a file; raise `UnreadableImage` if it cannot be read."""
    path = Path(path)
    try:
        return path.read_bytes()
    except IsADirectoryError:
        raise UnreadableImage(f"{path}: a folder, not an image") from None
    except OSError as error:
        raise UnreadableImage(f"{path}: {file_error(path, error)}") from None


def decode_image(data: bytes, name: str, *, apply_exif: bool = False) -> NDArray[Any]:
    """Decode the bytes of an image file as `read_image` does; error messages start with `name`."""
    defect = _find_defect(data)
    if defect is not None:
        raise UnreadableImage(f"{name}: {defect}")
    image = _decode(data)
    if image is None:
        raise UnreadableImage(f"{name}: {_describe_content(data)}")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    elif image.ndim == 3:
        image = swap_red_and_blue(image)
    if apply_exif:
        image = apply_orientation(image, exif_orientation(data))
    return np.ascontiguousarray(image)


def apply_orientation(image: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Rotate and flip an image (H, W, ...) by an EXIF orientation, 1 to 8; 5 to 8 swap width and height."""
    if orientation in (5, 6, 7, 8):
        image = np.swapaxes(image, 0, 1)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return image


def _find_defect(data: bytes) -> str | None:
    if not data:
        return "empty file"
    size = declared_size(data)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        return f"{size[0]} x {size[1]} pixels declared, more than the supported {MAX_PIXELS:.0e}"
    if data.startswith(JPEG_MAGIC):
        return find_jpeg_defect(data)
    if data.startswith(PNG_MAGIC):
        return find_png_defect(data)
    return None


def _decode(data: bytes) -> NDArray[Any] | None:
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    # IMREAD_UNCHANGED keeps depth and alpha, and is the only flag with which OpenCV ignores the EXIF orientation.
    flag = cv2.IMREAD_UNCHANGED
    try:
        if data.startswith((JPEG_MAGIC, PNG_MAGIC)):
            return cv2.imdecode(buffer, flag)
        # The structure of other formats is not checked above.
        with quiet_opencv():
            return cv2.imdecode(buffer, flag)
    except cv2.error:
        return None


def _describe_content(data: bytes) -> str:
    """Return what the bytes of a file that cannot be decoded contain."""
    if data[4:8] == b"ftyp":
        is_phone_image = data[8:12] in HEIF_BRANDS
        kind = "a HEIC or AVIF image, which is not supported" if is_phone_image else "a video, not an image"
        return f"{kind}: export it as JPEG or PNG"
    if data.startswith(b"version https://git-lfs"):
        return "a Git LFS pointer, not the image itself: run git lfs pull"
    for magic, kind in FORMAT_MAGICS.items():
        if data.startswith(magic):
            return f"damaged or unsupported {kind}"
    return f"not an image ({describe_start(data)})"
