"""OCamCalib's calib_results.txt."""

import re
from collections.abc import Mapping
from typing import cast

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._checks import left_out, number, picture_size, refuse, with_size
from omnisight.formats._scaramuzza import (
    INVERSE_PX,
    inverse_polynomial,
    model_of,
    picture_radius,
    radii_and_angles,
)
from omnisight.models.ocam import Ocam

TITLE = "OCamCalib text"
SUFFIX = ".txt"
MODELS = ("ocam",)
CONVENTION = (
    "x down, y right, z back, so a0 < 0; centre as row, column; size as height, width; integer pixel = pixel centre"
)
ROWS = ("direct polynomial", "inverse polynomial", "centre (row column)", "stretch (c d e)", "size (height width)")
COUNTED = re.compile(r"\s*\d{1,2}\s+[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?:\s|$)")
AGREES_PX = 0.5
MOST_INVERSE = 99  # coefficients


def matches(text: str) -> bool:
    """Say whether the first line that is no comment begins with a count and numbers."""
    for line in text.splitlines():
        if line.strip() and not _comment(line):
            return bool(COUNTED.match(line))
    return False


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, by the position of its lines: ports of OCamCalib word the comments in their own ways."""
    rows = [_numbers(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not _comment(line)]
    if len(rows) < len(ROWS):
        raise ValueError(f"ends before the {ROWS[len(rows)]}: {len(rows)} lines of numbers, {len(ROWS)} needed")
    direct, inverse = (_counted(row, name) for row, name in zip(rows, ROWS, strict=False) if "polynomial" in name)
    for row, name, count in zip(rows[2:5], ROWS[2:], (2, 3, 2), strict=True):
        if len(row) != count:
            raise ValueError(f"{name}: {count} numbers expected, got {len(row)}")
    (row, column), (c, d, e), (height, width) = rows[2:5]
    if not direct or direct[0] >= 0:
        raise ValueError(f"a0 must be negative (OCamCalib's z axis points back), got {direct[:1]}")
    if len(inverse) > MOST_INVERSE:
        raise ValueError(
            f"inverse polynomial: {len(inverse)} coefficients, {MOST_INVERSE} are the most: is it damaged?"
        )
    model = model_of([-value for value in direct], cx=column, cy=row, c=c, d=d, e=e)
    size = picture_size(width, height)
    # The inverse polynomial approximates what the model inverts exactly; one that does not is kept, to be looked at.
    with np.errstate(all="ignore"):
        r, theta = radii_and_angles(model, picture_radius(model, size))
        agrees = bool(inverse) and np.abs(np.polynomial.polynomial.polyval(theta, inverse) - r).max() < AGREES_PX
    extra: dict[str, object] = {} if agrees else {"inverse_polynomial": inverse}
    if rows[5:]:
        extra["further_lines"] = rows[5:]
    return {"camera": Camera(model, size, extra=extra)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with an inverse polynomial fitted anew."""
    refuse(camera, MODELS, "convert it with --model ocam")
    width, height = with_size(camera)
    model = cast(Ocam, camera.model)
    model_of(list(model.polynomial), cx=model.cx, cy=model.cy, c=model.c, d=model.d, e=model.e)
    direct = [0.0 - value for value in model.polynomial]
    inverse, error = inverse_polynomial(model, picture_radius(model, (width, height)))
    notes = left_out(camera)
    if error > INVERSE_PX:
        notes += (f"the inverse polynomial is {error:.2g} px off at most: programs that project with it are, too",)
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
    return "\n\n".join(lines) + "\n", notes


def _comment(line: str) -> bool:
    return line.lstrip().startswith(("#", "%", "//"))


def _numbers(line_number: int, line: str) -> list[float]:
    values: list[float] = []
    for word in line.split():
        try:
            values.append(number(float(word), f"line {line_number}"))
        except ValueError as error:
            raise ValueError(f"line {line_number}: expected finite numbers, got {word[:30]!r}") from error
    return values


def _counted(row: list[float], name: str) -> list[float]:
    if row[0] != len(row) - 1:
        raise ValueError(f"{name}: says {row[0]:g} coefficients and has {len(row) - 1}")
    return row[1:]


def _row(*values: float) -> str:
    return " ".join(repr(value) if isinstance(value, int) else repr(float(value)) for value in values)
