"""OCamCalib's calib_results.txt."""

import re
from collections.abc import Mapping
from typing import cast

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._checks import LONGEST, build, left_out, number, picture_size, refuse, with_size
from omnisight.models.ocam import Ocam

Array = NDArray[np.float64]

TITLE = "OCamCalib text"
SUFFIX = ".txt"
MODELS = ("ocam",)
CONVENTION = (
    "x down, y right, z back, so a0 < 0; centre as row, column; size as height, width; integer pixel = pixel centre"
)
ROWS = ("direct polynomial", "inverse polynomial", "centre (row column)", "stretch (c d e)", "size (height width)")
COUNTED = re.compile(r"\s*\d{1,2}\s+[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?:\s|$)")
A1_MAX = 1e-6  # an angle of less than a thousandth of an arc second
INVERSE_PX = 0.01
AGREES_PX = 0.5
HIGHEST_DEGREE = 30


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
    model = model_of([-value for value in direct], cx=column, cy=row, c=c, d=d, e=e)
    size = picture_size(width, height)
    # The inverse polynomial approximates what the model inverts exactly; one that does not is kept, to be looked at.
    with np.errstate(all="ignore"):
        r, theta = _radii_and_angles(model, picture_radius(model, size))
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


def inverse_polynomial(model: Ocam, radius: float) -> tuple[list[float], float]:
    """Fit the radius (px) as a polynomial in OCamCalib's angle, up to a radius.

    The angle is atan(z/r), from the plane of the image up, with z backwards: -90 degrees on the axis. The degree grows
    until the error is below a hundredth of a pixel.

    Returns
    -------
    coefficients
        From the constant up.
    error
        The largest error (px).
    """
    r, theta = _radii_and_angles(model, radius)
    found: list[tuple[float, list[float]]] = []
    for degree in range(3, HIGHEST_DEGREE + 1):
        inner = Chebyshev.fit(theta, r, degree)
        powers = inner.convert(kind=Polynomial, domain=[-1, 1], window=[-1, 1])
        found.append((float(np.abs(powers(theta) - r).max()), [float(p) for p in powers.coef]))
        if found[-1][0] < INVERSE_PX:
            break
    error, coefficients = min(found, key=lambda fit: fit[0])
    return coefficients, error


def _radii_and_angles(model: Ocam, radius: float) -> tuple[Array, Array]:
    r = radius * np.sin(np.linspace(0, np.pi / 2, 500))  # denser towards the rim, where r(theta) is steepest
    return r, np.arctan2(-np.polynomial.polynomial.polyval(r, model.polynomial), r)


def picture_radius(model: Ocam, size: tuple[int, int]) -> float:
    """Give the radius (px, before the stretch) of the picture's farthest corner that the model reaches."""
    corners = np.array([[x, y] for x in (-0.5, size[0] - 0.5) for y in (-0.5, size[1] - 0.5)]) - (model.cx, model.cy)
    plane = np.linalg.solve([[1.0, model.e], [model.d, model.c]], corners.T)
    return min(float(np.hypot(*plane).max()), model.radius_max())


def model_of(direct: list[float], *, cx: float, cy: float, c: float, d: float, e: float) -> Ocam:
    """Make the model from the coefficients of f(r) with z forward, a1 among them."""
    if not c - d * e > 0:
        raise ValueError(f"the stretch matrix [c d; e 1] must have a positive determinant, got {c:g}, {d:g}, {e:g}")
    if not direct or not 0 < direct[0] <= LONGEST:
        raise ValueError(f"a0 (px, z forward) must be positive and below {LONGEST:g}, got {direct[:1]}")
    if len(direct) > 1 and abs(direct[1]) > A1_MAX:
        raise ValueError(f"a1 must be 0 in OCamCalib's model, got {direct[1]:g}")
    a = [*direct[:1], *direct[2:]]
    names = Ocam.coefficient_names(len(a))
    made = build("ocam", {"cx": cx, "cy": cy, "c": c, "d": d, "e": e, **dict(zip(names, a, strict=True))})
    return cast(Ocam, made)


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
