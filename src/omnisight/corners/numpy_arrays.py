"""NumPy's .npz of points, as scripts around OpenCV save them.

`imgpoints` (image_points, corners): images x N x 2, px from 0, NaN where a point was not found. `objpoints`
(object_points): N x 3, or as many for each image; or `pattern`, columns and rows of inner corners, or --pattern.
`files` names the images; `image_size` is width, height. Nothing is unpickled, so lists of different lengths cannot be
read.
"""

import re
from typing import Any

from numpy.typing import NDArray

from omnisight.corners._protocol import Array, Corners, Seen, Told, in_space
from omnisight.formats._checks import picture_size
from omnisight.formats._numpy_file import TEXTS, ZIP, read_npz
from omnisight.targets import Checkerboard

TITLE = "NumPy npz of points"
SUFFIX = ".npz"
CONVENTION = "imgpoints images x N x 2, objpoints N x 3 (or of each image), or pattern; integer pixel = pixel centre"
SEEN = re.compile(r"(?:image|img)?(?:points|corners)2?d?|pixels")
POINTS = re.compile(r"(?:object|obj|world)(?:points|p)(?:3?d)?|objp")
FILES = {"files", "names", "images", "filenames"}
SIZE = {"imagesize", "size", "imgsize", "resolution"}


def matches(text: str) -> bool:
    """Say whether it holds corners by one of their names."""
    if not text.startswith(ZIP):
        return False
    try:
        return _named(read_npz(text), SEEN) is not None
    except ValueError:
        return False


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    held = read_npz(text)
    seen = _pictures(_named(held, SEEN), 2)
    points = _points(held, told, len(seen))
    size = (0, 0)
    sides = next((array for key, array in held.items() if _plain(key) in SIZE), None)
    if sides is not None and sides.size == 2:
        size = picture_size(*sides.ravel().astype(float).tolist())
    files = next((a for key, a in held.items() if _plain(key) in FILES and a.dtype.kind in TEXTS), None)
    names = [""] * len(seen) if files is None or files.size != len(seen) else [_text(name) for name in files.ravel()]
    views: list[Seen] = []
    for k, (name, x, p) in enumerate(zip(names, points, seen, strict=True), 1):
        if len(x) != len(p):
            raise ValueError(f"image {k} has {len(p)} corners, its board {len(x)} points")
        views.append(Seen(name, x, p, size=size))
    return Corners(views)


def _points(held: dict[str, NDArray[Any]], told: Told, count: int) -> list[Array]:
    """Give the points of each image's target."""
    given = _named(held, POINTS)
    if given is not None:
        points = [in_space(x) for x in _pictures(given, 3)]
        if len(points) not in (1, count):
            raise ValueError(f"points of {len(points)} targets, corners of {count} images")
        return points * count if len(points) == 1 else points
    if told.board is not None:
        return [told.board.points] * count
    pattern = next((array for key, array in held.items() if _plain(key) == "pattern"), None)
    if pattern is None or pattern.size != 2:
        raise ValueError("no objpoints in it, and no pattern: give --pattern, such as 9x6")
    columns, rows = (int(n) for n in pattern.ravel())
    if not (3 <= columns <= 1000 and 3 <= rows <= 1000):
        raise ValueError(f"pattern is {columns}x{rows}: expected 3 to 1000 inner corners each way")
    return [Checkerboard(columns, rows).points] * count


def _named(held: dict[str, NDArray[Any]], name: re.Pattern[str]) -> NDArray[Any] | None:
    found = [a for key, a in held.items() if name.fullmatch(_plain(key)) and a.dtype.kind in "iuf"]
    return found[0] if found else None


def _pictures(array: NDArray[Any] | None, columns: int) -> list[Array]:
    """Give (N, k) of each image, from (V, N, k), (V, N, 1, k), (V, 1, N, k), or (N, k) of all of them."""
    assert array is not None
    if array.ndim == 4 and 1 in array.shape[1:3]:
        array = array.reshape(len(array), -1, array.shape[-1])
    array = array[None] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[-1] not in (columns, 2):
        raise ValueError(f"points must be images x N x {columns}, got {array.shape}")
    return [picture.astype(float) for picture in array]


def _plain(key: str) -> str:
    return re.sub(r"[^a-z0-9]", "", key.lower())


def _text(name: Any) -> str:
    return name.decode("utf-8", errors="replace") if isinstance(name, bytes) else str(name)
