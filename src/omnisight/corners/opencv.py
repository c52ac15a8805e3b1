"""Points in OpenCV's FileStorage (YAML, XML, JSON), as its calibration samples write them.

`objectPoints` and `imagePoints`: a matrix per image; or `image_points` as one matrix with a row per image, and the
board as `board_width`, `board_height` and `square_size`, or `grid_points`. A stereo pair has `imagePoints1` and
`imagePoints2`. Matrices of float or double with 2 or 3 channels, px from 0.
"""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.corners._names import board_points, normalized
from omnisight.corners._protocol import Array, CornerFile, ImageCorners, ReadOptions, select_camera, to_3d
from omnisight.formats._limits import HEAD_CHARS
from omnisight.formats._opencv_storage import read_storage
from omnisight.formats._values import image_size, number

TITLE = "OpenCV points"
SUFFIX = ".yml"
CONVENTION = "objectPoints and imagePoints, a matrix per image; integer pixel = pixel centre"
PIXELS = re.compile(r"(?:image|img)points(\d?|left|right)")
POINTS = re.compile(r"(?:object|obj|world)points(\d?|left|right)|gridpoints")
SIDES = {"imagewidth", "width"}, {"imageheight", "height"}
BOARD = "boardwidth", "boardheight"
PIXELS_KEY = re.compile(r"(?:image|img)_?points", re.IGNORECASE)


def matches(text: str) -> bool:
    """Return whether OpenCV wrote image points in it."""
    storage = "opencv-matrix" in text or "<opencv_storage" in text[:HEAD_CHARS]
    return storage and PIXELS_KEY.search(text) is not None


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images of one camera."""
    data = read_storage(text)
    names = {key: normalized(key) for key in data}
    cameras = [key for key, name in names.items() if PIXELS.fullmatch(name)]
    if not cameras:
        raise ValueError(f"no imagePoints among {', '.join(list(data)[:20])}")
    pixels = _each(data[select_camera(cameras, options)], 2)
    points_keys = [key for key, name in names.items() if POINTS.fullmatch(name)]
    if points_keys:
        points = [to_3d(p) for p in _each(data[points_keys[0]], 3)]
        points = points * len(pixels) if len(points) == 1 else points
    else:
        sides = [next((data[key] for key, name in names.items() if name == side), None) for side in BOARD]
        missing = "no objectPoints in it, and no board_width and board_height"
        points = [board_points(options, None if None in sides else sides, missing)] * len(pixels)
    if len(points) != len(pixels):
        raise ValueError(f"objectPoints of {len(points)} images, imagePoints of {len(pixels)}")
    sides = [next((data[key] for key, name in names.items() if name in side), None) for side in SIDES]
    size = (0, 0) if None in sides else image_size(*sides)
    images: list[ImageCorners] = []
    for k, (x, p) in enumerate(zip(points, pixels, strict=True), 1):
        if len(x) != len(p) and len(p):
            raise ValueError(f"image {k} has {len(p)} imagePoints and {len(x)} objectPoints")
        images.append(ImageCorners("", x[: len(p)], p, size=size))
    return CornerFile(images)


def _each(value: Any, channels: int) -> list[Array]:
    """Return the points of each image, from a list of matrices or from one matrix with a row per image."""
    if isinstance(value, Mapping):
        rows = int(number(value.get("rows"), "rows"))
        points = _matrix(value, channels)
        return list(points.reshape(rows, -1, points.shape[-1])) if rows > 1 and _channels(value) > 1 else [points]
    if not isinstance(value, list):
        raise ValueError(f"points must be matrices, got {str(value)[:40]!r}")
    return [_matrix(entry, channels) for entry in value]


def _channels(matrix: Mapping[str, Any]) -> int:
    """Return the number of channels of a matrix."""
    words = re.fullmatch(r"\"?(\d?)[a-z]\"?", str(matrix.get("dt", "")))
    return int(words[1] or 1) if words else 1


def _matrix(value: Any, channels: int) -> Array:
    """Return the points (N, 2 or 3) of a matrix with as many channels or columns."""
    if not isinstance(value, Mapping) or not isinstance(value.get("data"), list):
        raise ValueError(f"points must be a matrix with rows, cols and data, got {str(value)[:40]!r}")
    channel_count = _channels(value)
    width = channel_count if channel_count > 1 else int(number(value.get("cols"), "cols"))
    if width not in (channels, 2):
        raise ValueError(f"points have {width} numbers each, expected 2 or 3")
    # A number that is not finite (.Nan) is read as a text and marks a corner that was not detected.
    flat = np.array([v if isinstance(v, int | float) and not isinstance(v, bool) else np.nan for v in value["data"]])
    if len(flat) % width:
        raise ValueError(f"a matrix of {len(flat)} numbers does not hold points of {width}")
    return flat.reshape(-1, width).astype(float)
