"""What OpenCV and ROS mean by a camera matrix and a list of coefficients."""

from typing import Any

from omnisight.formats._checks import build, number, numbers
from omnisight.models import CameraModel

# Our model by the number of coefficients without a fisheye or a mirror.
PERSPECTIVE = {4: "radial_tangential", 5: "radial_tangential", 8: "rational", 12: "rational", 14: "rational"}
NAMES = {
    "radial_tangential": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "mei": ("k1", "k2", "p1", "p2"),
}
FISHEYE = {"fisheye", "equidistant", "kannalabrandt", "kannalabrandt4"}
PLAIN = {"pinhole", "plumbbob", "radtan", "radialtangential", "brown", "rational", "rationalpolynomial"}
STRAIGHT = 1e-12  # px, of a skew or a zero of the camera matrix


def is_fisheye(value: Any, name: str) -> bool:
    """Tell a fisheye from a plain lens, by a flag or a name."""
    if isinstance(value, bool | int | float):
        return value != 0
    word = "".join(c for c in str(value).lower() if c.isalnum())
    if word not in FISHEYE | PLAIN:
        raise ValueError(f"{name} {value!r} is not known; there are {', '.join(sorted(FISHEYE | PLAIN))}")
    return word in FISHEYE


def matrix(value: Any, name: str) -> tuple[int, int, list[float]]:
    """Give rows, columns and the numbers of a matrix: a map with these names, a list of rows, a list, or one number."""
    if isinstance(value, dict):
        rows, columns, data = value.get("rows"), value.get("cols"), value.get("data")
        data = data if isinstance(data, list) else [data]
    elif isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        rows, columns, data = len(value), len(value[0]), [cell for row in value for cell in row]
    else:
        data = value if isinstance(value, list) else [value]
        rows, columns = (3, 3) if len(data) == 9 else (1, len(data))
    if not isinstance(rows, int) or not isinstance(columns, int) or rows * columns != len(data):
        raise ValueError(f"{name} must be a matrix, got {rows} x {columns} with {len(data)} numbers")
    return rows, columns, numbers(data, name)


def focal_and_centre(value: Any, name: str) -> dict[str, float]:
    """Give fx, fy, cx, cy and skew of a camera matrix."""
    rows, columns, k = matrix(value, name)
    if (rows, columns) != (3, 3):
        raise ValueError(f"{name} must be 3 x 3, got {rows} x {columns}")
    if max(map(abs, (k[3], k[6], k[7], k[8] - 1))) > STRAIGHT:
        raise ValueError(f"{name} must be [fx skew cx; 0 fy cy; 0 0 1], got {k}")
    return {"fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5], "skew": k[1]}


def lens(plane: dict[str, float], coefficients: list[float], *, fisheye: bool | None, xi: Any = None) -> CameraModel:
    """Make the model that OpenCV would project with.

    Parameters
    ----------
    plane
        Of `focal_and_centre`.
    coefficients
        In OpenCV's order.
    fisheye
        What the file says; None where it does not.
    xi
        Of the unified model, None where there is none.
    """
    count, zero = len(coefficients), not any(coefficients)
    if xi is not None:
        if count not in (0, 4):
            raise ValueError(f"a camera with xi (omnidir) has 4 coefficients k1 k2 p1 p2, got {count}")
        values = {**plane, "xi": number(xi, "xi")}
        return build("unified", values) if zero else build("mei", values | _named("mei", coefficients))
    if fisheye:
        if count != 4:
            raise ValueError(f"a fisheye has 4 coefficients k1 k2 k3 k4, got {count}")
        return build("kannala_brandt", _straight(plane) | _named("kannala_brandt", coefficients))
    if count == 4 and fisheye is None:
        raise ValueError(
            "4 coefficients are ambiguous: a fisheye's k1 k2 k3 k4 or a plain lens's k1 k2 p1 p2;"
            " add `fisheye_model: 1` or `fisheye_model: 0`"
        )
    if count not in (0, *PERSPECTIVE):
        raise ValueError(f"{count} coefficients; a plain lens has 0, 4, 5, 8, 12 or 14")
    if zero:
        return build("pinhole", plane)
    if any(coefficients[8:]):
        raise ValueError(f"thin-prism and tilt coefficients are not supported, got {coefficients[8:]}")
    model = PERSPECTIVE[count]
    return build(model, _straight(plane) | _named(model, coefficients))


def coefficients_of(values: dict[str, float], model: str) -> list[float]:
    """Give the coefficients of a camera in OpenCV's order; as many zeros as OpenCV likes where it has none."""
    names = NAMES.get({"unified": "mei", "pinhole": "radial_tangential"}.get(model, model), ())
    return [values.get(name, 0.0) for name in names]


def _named(model: str, coefficients: list[float]) -> dict[str, float]:
    return dict.fromkeys(NAMES[model], 0.0) | dict(zip(NAMES[model], coefficients, strict=False))


def _straight(plane: dict[str, float]) -> dict[str, float]:
    if abs(plane["skew"]) > STRAIGHT:
        raise ValueError(f"the camera matrix has a skew of {plane['skew']:g} px, which this lens model ignores")
    return {name: value for name, value in plane.items() if name != "skew"}
