"""NumPy's .npz of points, as scripts around OpenCV save them.

`imgpoints` (image_points, corners): images x N x 2, px from 0, NaN for a point that was not detected. `objpoints`
(object_points): N x 3, or one such array for each image; or `pattern`, columns and rows of inner corners, or --pattern.
`files` holds the names of the images; `image_size` is width, height. Nothing is unpickled, so lists of different
lengths cannot be read.
"""

import re
from typing import Any

from numpy.typing import NDArray

from omnisight.corners._names import board_points, normalized
from omnisight.corners._protocol import Array, CornerFile, ImageCorners, ReadOptions, to_3d
from omnisight.formats._npz import TEXT_KINDS, ZIP_SIGNATURE, read_npz
from omnisight.formats._values import image_size

TITLE = "NumPy npz of points"
SUFFIX = ".npz"
CONVENTION = "imgpoints images x N x 2, objpoints N x 3 (or of each image), or pattern; integer pixel = pixel centre"
PIXELS = re.compile(r"(?:image|img)?(?:points|corners)2?d?|pixels")
POINTS = re.compile(r"(?:object|obj|world)(?:points|p)(?:3?d)?|objp")
FILES = {"files", "names", "images", "filenames"}
SIZE = {"imagesize", "size", "imgsize", "resolution"}


def matches(text: str) -> bool:
    """Return whether it holds corners under one of their names."""
    if not text.startswith(ZIP_SIGNATURE):
        return False
    try:
        return _named(read_npz(text), PIXELS) is not None
    except ValueError:
        return False


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    arrays = read_npz(text)
    pixels = _per_image(_named(arrays, PIXELS), 2)
    points = _points(arrays, options, len(pixels))
    size = (0, 0)
    sides = next((array for key, array in arrays.items() if normalized(key) in SIZE), None)
    if sides is not None and sides.size == 2:
        size = image_size(*sides.ravel().astype(float).tolist())
    files = next((a for key, a in arrays.items() if normalized(key) in FILES and a.dtype.kind in TEXT_KINDS), None)
    has_names = files is not None and files.size == len(pixels)
    names = [_text(name) for name in files.ravel()] if files is not None and has_names else [""] * len(pixels)
    images: list[ImageCorners] = []
    for k, (name, x, p) in enumerate(zip(names, points, pixels, strict=True), 1):
        if len(x) != len(p):
            raise ValueError(f"image {k} has {len(p)} corners, its board {len(x)} points")
        images.append(ImageCorners(name, x, p, size=size))
    return CornerFile(images)


def _points(arrays: dict[str, NDArray[Any]], options: ReadOptions, count: int) -> list[Array]:
    """Return the points of the target of each image."""
    given = _named(arrays, POINTS)
    if given is not None:
        points = [to_3d(x) for x in _per_image(given, 3)]
        if len(points) not in (1, count):
            raise ValueError(f"points of {len(points)} targets, corners of {count} images")
        return points * count if len(points) == 1 else points
    pattern = next((array for key, array in arrays.items() if normalized(key) == "pattern"), None)
    sides = [int(n) for n in pattern.ravel()] if pattern is not None and pattern.size == 2 else None
    return [board_points(options, sides, "no objpoints and no pattern in it")] * count


def _named(arrays: dict[str, NDArray[Any]], name: re.Pattern[str]) -> NDArray[Any] | None:
    """Return the first array of numbers whose name matches, or None."""
    matching = (a for key, a in arrays.items() if name.fullmatch(normalized(key)) and a.dtype.kind in "iuf")
    return next(matching, None)


def _per_image(array: NDArray[Any] | None, columns: int) -> list[Array]:
    """Return (N, k) of each image, from (V, N, k), (V, N, 1, k), (V, 1, N, k), or (N, k) of all of them."""
    assert array is not None
    if array.ndim == 4 and 1 in array.shape[1:3]:
        array = array.reshape(len(array), -1, array.shape[-1])
    array = array[None] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[-1] not in (columns, 2):
        raise ValueError(f"points must be images x N x {columns}, got {array.shape}")
    return [image.astype(float) for image in array]


def _text(name: Any) -> str:
    return name.decode("utf-8", errors="replace") if isinstance(name, bytes) else str(name)
