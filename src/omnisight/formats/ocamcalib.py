"""OCamCalib's calib_results.txt."""

import re
from collections.abc import Mapping
from typing import cast

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._export import check_supported, dropped_fields, known_size
from omnisight.formats._limits import MAX_INVERSE_TERMS
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import inverse_polynomial, model_of, radii_and_angles
from omnisight.formats._values import image_size, number
from omnisight.models.ocam import Ocam

TITLE = "OCamCalib text"
SUFFIX = ".txt"
MODELS = ("ocam",)
CONVENTION = (
    "x down, y right, z back, so a0 < 0; centre as row, column; size as height, width; integer pixel = pixel centre"
)
ROWS = ("direct polynomial", "inverse polynomial", "centre (row column)", "stretch (c d e)", "size (height width)")
COUNT_AND_NUMBER = re.compile(r"\s*\d{1,2}\s+[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?:\s|$)")
MAX_INVERSE_DIFFERENCE_PX = 0.5  # an inverse polynomial that differs more is kept for inspection
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether the first line that is not a comment begins with a count and numbers."""
    for line in text.splitlines():
        if line.strip() and not _is_comment(line):
            return bool(COUNT_AND_NUMBER.match(line))
    return False


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera by the order of its lines; ports of OCamCalib word the comments differently."""
    rows = [_numbers(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not _is_comment(line)]
    if len(rows) < len(ROWS):
        raise ValueError(f"ends before the {ROWS[len(rows)]}: {len(rows)} lines of numbers, {len(ROWS)} needed")
    direct, inverse = (_counted(row, name) for row, name in zip(rows, ROWS, strict=False) if "polynomial" in name)
    for row, name, count in zip(rows[2:5], ROWS[2:], (2, 3, 2), strict=True):
        if len(row) != count:
            raise ValueError(f"{name}: {count} numbers expected, got {len(row)}")
    (row, column), (c, d, e), (height, width) = rows[2:5]
    if not direct or direct[0] >= 0:
        raise ValueError(f"a0 must be negative (OCamCalib's z axis points back), got {direct[:1]}")
    if len(inverse) > MAX_INVERSE_TERMS:
        raise ValueError(
            f"inverse polynomial: {len(inverse)} coefficients, at most {MAX_INVERSE_TERMS} are read: is it damaged?"
        )
    model = model_of([-value for value in direct], cx=column, cy=row, c=c, d=d, e=e)
    size = image_size(width, height)
    # The inverse polynomial only approximates the inverse of the model, which is computed exactly.
    with np.errstate(all="ignore"):
        r, theta = radii_and_angles(model, size)
        difference = np.abs(np.polynomial.polynomial.polyval(theta, inverse or [0.0]) - r).max()
    agrees = bool(inverse) and difference < MAX_INVERSE_DIFFERENCE_PX
    extra: dict[str, object] = {} if agrees else {"inverse_polynomial": inverse}
    if rows[5:]:
        extra["further_lines"] = rows[5:]
    return {"camera": Camera(model, size, extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with a new inverse polynomial."""
    check_supported(camera, MODELS)
    width, height = known_size(camera)
    model = cast(Ocam, camera.model)
    model_of(list(model.polynomial), cx=model.cx, cy=model.cy, c=model.c, d=model.d, e=model.e)
    direct = [0.0 - value for value in model.polynomial]
    inverse, notes = inverse_polynomial(model, (width, height))
    lines = (
        "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). "
        "These are used by cam2world",
        _row(len(direct), *direct),
        "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). "
        "These are used by world2cam",
        _row(len(inverse), *inverse),
        '#center: "row" and "column", starting from 0 (C convention)',
        _row(model.cy, model.cx),
        '#affine parameters "c", "d", "e"',
        _row(model.c, model.d, model.e),
        '#image size: "height" and "width"',
        _row(height, width),
    )
    return "\n\n".join(lines) + "\n", dropped_fields(camera) + notes


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%", "//"))


def _numbers(line_number: int, line: str) -> list[float]:
    """Return the numbers of a line."""
    values: list[float] = []
    for word in line.split():
        try:
            values.append(number(float(word), f"line {line_number}"))
        except ValueError as error:
            raise ValueError(f"line {line_number}: expected finite numbers, got {word[:30]!r}") from error
    return values


def _counted(row: list[float], name: str) -> list[float]:
    """Return the coefficients of a row that begins with their count."""
    if row[0] != len(row) - 1:
        raise ValueError(f"{name}: claims {row[0]:g} coefficients and has {len(row) - 1}")
    return row[1:]


def _row(*values: float) -> str:
    return " ".join(repr(value) if isinstance(value, int) else repr(float(value)) for value in values)
