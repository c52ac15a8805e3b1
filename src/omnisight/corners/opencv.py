"""Points in OpenCV's FileStorage (YAML, XML, JSON), as its calibration samples write them.

`objectPoints` and `imagePoints`: a matrix per image; or `image_points` as one matrix with a row per image, and the
board as `board_width`, `board_height` and `square_size`, or `grid_points`. Of a stereo pair `imagePoints1` and
`imagePoints2`. Matrices of float or double with 2 or 3 channels, px from 0.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.corners._protocol import Array, Corners, Seen, Told, in_space, one_of
from omnisight.formats._checks import number, picture_size
from omnisight.formats._opencv_storage import read_storage
from omnisight.targets import Checkerboard

TITLE = "OpenCV points"
SUFFIX = ".yml"
CONVENTION = "objectPoints and imagePoints, a matrix per image; integer pixel = pixel centre"
SEEN = re.compile(r"(?:image|img)points(\d?|left|right)")
POINTS = re.compile(r"(?:object|obj|world)points(\d?|left|right)|gridpoints")
SIDES = {"imagewidth", "width"}, {"imageheight", "height"}
BOARD = "boardwidth", "boardheight"
MARK = re.compile(r"(?:image|img)_?points", re.IGNORECASE)


def matches(text: str) -> bool:
    """Say whether OpenCV wrote image points there."""
    storage = "opencv-matrix" in text or "<opencv_storage" in text[:2000]
    return storage and MARK.search(text) is not None


def parse(text: str, told: Told) -> Corners:
    """Read the images of one camera."""
    data = read_storage(text)
    plain = {key: re.sub(r"[^a-z0-9]", "", key.lower()) for key in data}
    seen = [key for key, word in plain.items() if SEEN.fullmatch(word)]
    if not seen:
        raise ValueError(f"no imagePoints among {', '.join(list(data)[:20])}")
    pictures = _each(data[one_of(seen, told)], 2)
    known = [key for key, word in plain.items() if POINTS.fullmatch(word)]
    if known:
        points = [in_space(p) for p in _each(data[known[0]], 3)]
        points = points * len(pictures) if len(points) == 1 else points
    else:
        points = [_board(data, plain, told)] * len(pictures)
    if len(points) != len(pictures):
        raise ValueError(f"objectPoints of {len(points)} images, imagePoints of {len(pictures)}")
    size = (0, 0)
    sides = [next((data[key] for key, word in plain.items() if word in names), None) for names in SIDES]
    if None not in sides:
        size = picture_size(*sides)
    views: list[Seen] = []
    for k, (x, p) in enumerate(zip(points, pictures, strict=True), 1):
        if len(x) != len(p) and len(p):
            raise ValueError(f"image {k} has {len(p)} imagePoints and {len(x)} objectPoints")
        views.append(Seen("", x[: len(p)], p, size=size))
    return Corners(views)


def _each(value: Any, channels: int) -> list[Array]:
    """Give the points of each image: of a list of matrices, or of one matrix with a row per image."""
    if isinstance(value, Mapping):
        rows = int(number(value.get("rows"), "rows"))
        found = _matrix(value, channels)
        return list(found.reshape(rows, -1, found.shape[-1])) if rows > 1 and _channels(value) > 1 else [found]
    if not isinstance(value, list):
        raise ValueError(f"points must be matrices, got {str(value)[:40]!r}")
    return [_matrix(entry, channels) for entry in value]


def _channels(matrix: Mapping[str, Any]) -> int:
    words = re.fullmatch(r"\"?(\d?)[a-z]\"?", str(matrix.get("dt", "")))
    return int(words[1] or 1) if words else 1


def _matrix(value: Any, channels: int) -> Array:
    """Give the rows (N, 2 or 3) of a matrix of as many channels, or columns."""
    if not isinstance(value, Mapping) or not isinstance(value.get("data"), list):
        raise ValueError(f"points must be a matrix with rows, cols and data, got {str(value)[:40]!r}")
    held = _channels(value)
    across = held if held > 1 else int(number(value.get("cols"), "cols"))
    if across not in (channels, 2):
        raise ValueError(f"points have {across} numbers each, 2 or 3 expected")
    # What is not finite (.Nan) is read as a word: a corner that was not found.
    flat = np.array([v if isinstance(v, int | float) and not isinstance(v, bool) else np.nan for v in value["data"]])
    if len(flat) % across:
        raise ValueError(f"a matrix of {len(flat)} numbers does not hold points of {across}")
    return flat.reshape(-1, across).astype(float)


def _board(data: Mapping[str, Any], plain: Mapping[str, str], told: Told) -> Array:
    if told.board is not None:
        return told.board.points
    sides = [next((data[key] for key, word in plain.items() if word == name), 0) for name in BOARD]
    if not all(isinstance(side, int) and 3 <= side <= 1000 for side in sides):
        raise ValueError("no objectPoints in it, and no board_width and board_height: give --pattern, such as 9x6")
    return Checkerboard(*sides).points
