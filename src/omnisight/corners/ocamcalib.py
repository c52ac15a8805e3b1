"""OCamCalib's corners in a .mat: Xt, Yt, Xp_abs, Yp_abs, as its scripts name them.

Xt, Yt are the points of the board (M x 1), Xp_abs, Yp_abs their pixels (M x 1 x images) from ONE: Xp_abs
is the ROW and Yp_abs the column, as in its `plot(Yp_abs, Xp_abs)`. `ima_proc` lists the images in use. Version 3 stores
all of it in an object `calib_data`, which is code, and refused.
"""

from typing import Any

import numpy as np

from omnisight.corners._matlab import matrix_of, read_variables, variables_or_none
from omnisight.corners._protocol import CornerFile, ImageCorners, ReadOptions
from omnisight.formats._values import FIRST_PIXEL, image_size

TITLE = "OCamCalib .mat"
SUFFIX = ".mat"
CONVENTION = "Xp_abs is the row and Yp_abs the column, both from ONE; size as width and height"
NAMES = ("Xt", "Yt", "Xp_abs", "Yp_abs")
OBJECT = "calib_data"
EXTRACT_COMMAND = (
    "in MATLAB, with the toolbox on its path and this file loaded: c = calib_data; Xt = c.Xt; Yt = c.Yt; Xp_abs ="
    " c.Xp_abs; Yp_abs = c.Yp_abs; ima_proc = c.ima_proc; width = c.ocam_model.width; height = c.ocam_model.height;"
    " save('corners.mat', 'Xt', 'Yt', 'Xp_abs', 'Yp_abs', 'ima_proc', 'width', 'height', '-v7')"
)


def matches(text: str) -> bool:
    """Return whether this is a .mat with these variables, or with the object that has them."""
    variables = variables_or_none(text) or {}
    return _fields(variables) is not None or OBJECT in variables


def parse(text: str, options: ReadOptions) -> CornerFile:
    """Read the images."""
    variables = read_variables(text)
    fields = _fields(variables)
    if fields is None:
        raise ValueError(f"{OBJECT} is an object of OCamCalib, which is code: extract its numbers; {EXTRACT_COMMAND}")
    x, y = (np.ravel(matrix_of(fields[name], name)) for name in NAMES[:2])
    row, column = (matrix_of(fields[name], name).reshape(len(x), -1, order="F") for name in NAMES[2:])
    if len(y) != len(x) or row.shape != column.shape:
        raise ValueError(f"{len(x)} Xt, {len(y)} Yt, {row.shape} Xp_abs and {column.shape} Yp_abs do not fit together")
    points = np.stack([x, y, np.zeros(len(x))], -1)
    size = _size(fields, variables)
    if fields.get("ima_proc") is not None:
        used = {int(k) - 1 for k in np.ravel(matrix_of(fields["ima_proc"], "ima_proc"))}
    else:
        used = set(range(row.shape[1]))
    images = [
        ImageCorners("", points, np.stack([column[:, k], row[:, k]], -1) - FIRST_PIXEL, size=size)
        if k in used and (column[:, k] != 0).any()
        else ImageCorners.empty(size=size)
        for k in range(row.shape[1])
    ]
    return CornerFile(images)


def _fields(variables: dict[str, Any]) -> dict[str, Any] | None:
    """Return what has all names: the variables of the file, or a struct among them."""
    for fields in (variables, *variables.values()):
        if isinstance(fields, dict) and set(NAMES) <= set(fields):
            return fields
    return None


def _size(fields: dict[str, Any], variables: dict[str, Any]) -> tuple[int, int]:
    """Return the image size, (0, 0) if unknown."""
    for record in (fields, fields.get("ocam_model"), variables, variables.get("ocam_model")):
        if isinstance(record, dict) and record.get("width") and record.get("height"):
            return image_size(record["width"][0], record["height"][0])
    return (0, 0)
