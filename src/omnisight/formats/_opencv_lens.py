"""Camera matrices and lists of distortion coefficients as OpenCV and ROS define them."""

import math
from typing import Any

from omnisight.formats._readers import Reader
from omnisight.formats._values import build, number, numbers
from omnisight.models import CameraModel

# The model by the number of coefficients of a lens that is neither a fisheye nor behind a mirror.
PERSPECTIVE = {4: "radial_tangential", 5: "radial_tangential", 8: "rational", 12: "rational", 14: "rational"}
NAMES = {
    "radial_tangential": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "mei": ("k1", "k2", "p1", "p2"),
}
FISHEYE = {"fisheye", "equidistant", "kannalabrandt", "kannalabrandt4"}
PLAIN = {"pinhole", "plumbbob", "radtan", "radialtangential", "brown", "rational", "rationalpolynomial"}
MAX_SKEW_PX = 1e-12  # rounding of a skew or a zero in the camera matrix
# What OpenCV does with the coefficients. cv2.fisheye clamps theta_d, the radius in focal lengths, to pi/2.
CV2_PERSPECTIVE = Reader("cv2.projectPoints (OpenCV 5.0)", 90, "projects points to the opposite side of the image")
CV2_FISHEYE = Reader(
    "cv2.fisheye (OpenCV 5.0)",
    90,
    "unprojects pixels to smaller angles, and past 90 degrees projects points to the opposite side, without a flag",
    max_radius=math.pi / 2,
)
CV2_OMNIDIR = Reader("cv2.omnidir.projectPoints (OpenCV 5.0)")
CV2_READERS = {
    "kannala_brandt": CV2_FISHEYE,
    "mei": CV2_OMNIDIR,
    "unified": CV2_OMNIDIR,
    **dict.fromkeys(("radial_tangential", "rational", "pinhole"), CV2_PERSPECTIVE),
}


def is_fisheye(value: Any, name: str) -> bool:
    """Return whether a flag or the name of a distortion model denotes a fisheye."""
    if isinstance(value, bool | int | float):
        return value != 0
    word = "".join(c for c in str(value).lower() if c.isalnum())
    if word not in FISHEYE | PLAIN:
        raise ValueError(f"{name} {value!r} is not known; there are {', '.join(sorted(FISHEYE | PLAIN))}")
    return word in FISHEYE


def matrix(value: Any, name: str) -> tuple[int, int, list[float]]:
    """Return rows, columns and numbers of a matrix: a map with these names, a list of rows, a list, or one number."""
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
    """Return fx, fy, cx, cy and skew of a camera matrix."""
    rows, columns, k = matrix(value, name)
    if (rows, columns) != (3, 3):
        raise ValueError(f"{name} must be 3 x 3, got {rows} x {columns}")
    if max(map(abs, (k[3], k[6], k[7], k[8] - 1))) > MAX_SKEW_PX:
        raise ValueError(f"{name} must be [fx skew cx; 0 fy cy; 0 0 1], got {k}")
    return {"fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5], "skew": k[1]}


def lens(plane: dict[str, float], coefficients: list[float], *, fisheye: bool | None, xi: Any = None) -> CameraModel:
    """Return the camera model that OpenCV would project with.

    Parameters
    ----------
    plane
        The values of `focal_and_centre`.
    coefficients
        In OpenCV's order.
    fisheye
        Whether the lens is a fisheye; None if the file does not specify it.
    xi
        The parameter of the unified model, or None.
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
        return build("kannala_brandt", _without_skew(plane) | _named("kannala_brandt", coefficients))
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
    return build(model, _without_skew(plane) | _named(model, coefficients))


def coefficients_of(values: dict[str, float], model: str) -> list[float]:
    """Return the coefficients of a camera in OpenCV's order, zeros for a model without distortion."""
    names = NAMES.get({"unified": "mei", "pinhole": "radial_tangential"}.get(model, model), ())
    return [values.get(name, 0.0) for name in names]


def camera_matrix(values: dict[str, float]) -> list[list[float]]:
    """Return the 3 x 3 camera matrix."""
    return [[values["fx"], values.get("skew", 0.0), values["cx"]], [0.0, values["fy"], values["cy"]], [0.0, 0.0, 1.0]]


def _named(model: str, coefficients: list[float]) -> dict[str, float]:
    """Return coefficients by name, zero where the list ends."""
    return dict.fromkeys(NAMES[model], 0.0) | dict(zip(NAMES[model], coefficients, strict=False))


def _without_skew(plane: dict[str, float]) -> dict[str, float]:
    """Return fx, fy, cx and cy, or raise ValueError for a skew."""
    if abs(plane["skew"]) > MAX_SKEW_PX:
        raise ValueError(f"the camera matrix has a skew of {plane['skew']:g} px, which this lens model ignores")
    return {name: value for name, value in plane.items() if name != "skew"}
