"""OCamCalib's corners in a .mat: Xt, Yt, Xp_abs, Yp_abs, as its scripts name them.

Xt, Yt are the points of the board (M x 1), Xp_abs, Yp_abs where they are seen (M x 1 x images), both from ONE: Xp_abs
is the ROW and Yp_abs the column, for its plots draw `plot(Yp_abs, Xp_abs)`. `ima_proc` lists the images that count.
Version 3 keeps all of it in an object `calib_data`, which is code, and refused.
"""

from typing import Any

import numpy as np

from omnisight.corners._matlab import FIRST, array_of
from omnisight.corners._protocol import Corners, Seen, Told
from omnisight.formats._checks import picture_size
from omnisight.formats._matlab_file import read_mat

TITLE = "OCamCalib .mat"
SUFFIX = ".mat"
CONVENTION = "Xp_abs is the row and Yp_abs the column, both from ONE; size as width and height"
NAMES = ("Xt", "Yt", "Xp_abs", "Yp_abs")
OBJECT = "calib_data"
HELP = (
    "in MATLAB, with the toolbox on its path and this file loaded: c = calib_data; Xt = c.Xt; Yt = c.Yt; Xp_abs ="
    " c.Xp_abs; Yp_abs = c.Yp_abs; ima_proc = c.ima_proc; width = c.ocam_model.width; height = c.ocam_model.height;"
    " save('corners.mat', 'Xt', 'Yt', 'Xp_abs', 'Yp_abs', 'ima_proc', 'width', 'height', '-v7')"
)


def matches(text: str) -> bool:
    """Say whether this is a .mat with such names, or with the object that has them."""
    if not text.startswith("MATLAB 5.0 "):
        return False
    try:
        held = read_mat(text.encode("latin-1"))
    except ValueError:
        return False
    return _fields(held) is not None or OBJECT in held


def parse(text: str, told: Told) -> Corners:
    """Read the images."""
    held = read_mat(text.encode("latin-1"))
    fields = _fields(held)
    if fields is None:
        raise ValueError(f"{OBJECT} is an object of OCamCalib, which is code: take out its numbers; {HELP}")
    x, y = (np.ravel(array_of(fields[name], name)) for name in NAMES[:2])
    row, column = (array_of(fields[name], name).reshape(len(x), -1, order="F") for name in NAMES[2:])
    if len(y) != len(x) or row.shape != column.shape:
        raise ValueError(f"{len(x)} Xt, {len(y)} Yt, {row.shape} Xp_abs and {column.shape} Yp_abs do not fit together")
    points = np.stack([x, y, np.zeros(len(x))], -1)
    size = _size(fields, held)
    if fields.get("ima_proc") is not None:
        used = {int(k) - 1 for k in np.ravel(array_of(fields["ima_proc"], "ima_proc"))}
    else:
        used = set(range(row.shape[1]))
    views = [
        Seen("", points, np.stack([column[:, k], row[:, k]], -1) - FIRST, size=size)
        if k in used and (column[:, k] != 0).any()
        else Seen("", points[:0], np.zeros((0, 2)), size=size)
        for k in range(row.shape[1])
    ]
    return Corners(views)


def _fields(held: dict[str, Any]) -> dict[str, Any] | None:
    """Give what has all names: the file itself, or a struct in it."""
    for fields in (held, *held.values()):
        if isinstance(fields, dict) and set(NAMES) <= set(fields):
            return fields
    return None


def _size(fields: dict[str, Any], held: dict[str, Any]) -> tuple[int, int]:
    for place in (fields, fields.get("ocam_model"), held, held.get("ocam_model")):
        if isinstance(place, dict) and place.get("width") and place.get("height"):
            return picture_size(place["width"][0], place["height"][0])
    return (0, 0)
