"""Check the numbers that a file holds and build camera models from them."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.formats._limits import MAX_POLYNOMIAL_TERMS
from omnisight.geometry.rotation import nearest
from omnisight.models import CameraModel, model_class
from omnisight.models._parameterized import Parameterized
from omnisight.models.ocam import Ocam

HALF_PIXEL = 0.5  # px, the centre of the top-left pixel in formats whose origin is the corner of the image
FIRST_PIXEL = 1.0  # px, the centre of the top-left pixel in MATLAB
MAX_SIDE_PX = 1_000_000
MIN_FOCAL_PX, MAX_FOCAL_PX = 1e-6, 1e7
MAX_VALUE = 1e12  # products of larger parameters overflow
MIN_NONZERO_VALUE = 1e-150  # squares of smaller parameters underflow; they are read as 0
MAX_ROTATION_ERROR = 1e-6  # of an entry of a rotation matrix; larger errors are not rounding
FOCAL_LENGTHS = ("fx", "fy", "a0")


def number(value: Any, name: str, limit: float = MAX_VALUE) -> float:
    """Return a number of a file; raise ValueError if it is not a number, not finite or beyond a limit."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= limit:
        raise ValueError(f"{name} must be a number, got {value!r}")
    return float(value) if abs(value) >= MIN_NONZERO_VALUE else 0.0


def numbers(values: Any, name: str, count: int | None = None, limit: float = MAX_VALUE) -> list[float]:
    """Return a list of numbers, of this length if one is given."""
    if not isinstance(values, list) or (count is not None and len(values) != count):
        actual = f"{len(values)}" if isinstance(values, list) else repr(values)
        raise ValueError(f"{name} must be a list of {'' if count is None else f'{count} '}numbers, got {actual}")
    return [number(value, f"{name}[{i}]", limit) for i, value in enumerate(values)]


def rotation_matrix(rows: Any, name: str) -> NDArray[np.float64]:
    """Return a rotation (3, 3) of a file, made exactly orthogonal; raise ValueError if it is none."""
    if not isinstance(rows, list) or len(rows) != 3:
        raise ValueError(f"{name} must have 3 rows of 3 numbers")
    given = np.array([numbers(row, name, 3) for row in rows])
    orthogonal = nearest(given)
    error = np.abs(orthogonal - given).max()
    if error > MAX_ROTATION_ERROR:
        raise ValueError(f"{name} is not a rotation matrix: it differs from the nearest one by {error:.2g}")
    return orthogonal


def mapping(value: Any, name: str) -> Mapping[str, Any]:
    """Return a map of a file, or raise ValueError."""
    if not isinstance(value, dict):
        raise ValueError(f"{name} must hold names and values, got {value!r:.40}")
    return value


def image_size(width: Any, height: Any) -> tuple[int, int]:
    """Return (width, height) in px; some tools write 640.0."""
    sides = [number(side, name) for side, name in ((width, "image width"), (height, "image height"))]
    for side, name in zip(sides, ("width", "height"), strict=True):
        if side != int(side) or not 1 <= side <= MAX_SIDE_PX:
            raise ValueError(f"image {name} must be a whole number from 1 to {MAX_SIDE_PX}, got {side:g}")
    return int(sides[0]), int(sides[1])


def build(model: str, values: Mapping[str, Any]) -> CameraModel:
    """Build a camera model from its parameters by name; the focal length must be positive."""
    for name in FOCAL_LENGTHS:
        if name in values and not 0 < number(values[name], name) <= MAX_FOCAL_PX:
            raise ValueError(
                f"{name} (focal length, px) must be positive and below {MAX_FOCAL_PX:g}, got {values[name]:g}"
            )
    return build_mirrored(model, values)


def build_with_zeros(model: str, values: Mapping[str, Any]) -> CameraModel:
    """Build a camera model; a parameter without a value, such as an absent distortion coefficient, is zero."""
    return build(model, dict.fromkeys(model_class(model).example().param_names, 0.0) | dict(values))


def build_mirrored(model: str, values: Mapping[str, Any]) -> CameraModel:
    """Build a camera model whose focal length is negative if it sees the world in a mirror."""
    made = model_class(model).from_dict({name: number(value, name) for name, value in values.items()})
    check_model(made)
    return made


def check_model(model: CameraModel) -> None:
    """Raise ValueError for parameters that no camera has."""
    if isinstance(model, Ocam):
        check_term_count(len(model.a))
    values = model.to_dict()
    for name in FOCAL_LENGTHS:
        if name in values and abs(values[name]) < MIN_FOCAL_PX:
            raise ValueError(f"{name} (focal length, px) must be {MIN_FOCAL_PX:g} or longer, got {values[name]:g}")
    check_bounds(model)
    try:
        # The model computes its domain here, where numbers that overflow show.
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            _ = model.kernel
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        listed = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        raise ValueError(
            f"no {model.name} camera has these numbers ({error}): {listed:.300}; is the file damaged? Save it again"
            " with the program that made it"
        ) from error


def check_bounds(model: Parameterized) -> None:
    """Raise ValueError for a parameter outside its bounds."""
    for parameter, value in zip(model.parameters, model.params, strict=True):
        if not parameter.low <= value <= parameter.high:
            raise ValueError(f"{parameter.name} must lie in [{parameter.low:g}, {parameter.high:g}], got {value:g}")


def check_term_count(count: int) -> None:
    """Raise ValueError if Scaramuzza's f(r) has too many coefficients."""
    if count > MAX_POLYNOMIAL_TERMS:
        raise ValueError(
            f"f(r) has {count} coefficients, at most {MAX_POLYNOMIAL_TERMS} are read: is the file damaged?"
            " Calibrate with a polynomial of lower degree"
        )


def whole_sphere(size: tuple[int, int]) -> dict[str, float]:
    """Return the parameters of an equirectangular image of the whole sphere with forward in its centre."""
    centre = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    return {"fx": size[0] / (2 * math.pi), "fy": size[1] / math.pi, **centre}


def unified_from_alpha(values: Mapping[str, float]) -> dict[str, float]:
    """Return xi = alpha/(1 - alpha) and the focal lengths of xi for a unified model in terms of alpha."""
    alpha = values["alpha"]
    if not alpha < 1:
        raise ValueError(f"alpha of the unified model must be below 1, got {alpha:g}")
    rest = {name: value for name, value in values.items() if name != "alpha"}
    return rest | {"xi": alpha / (1 - alpha), "fx": values["fx"] / (1 - alpha), "fy": values["fy"] / (1 - alpha)}


def alpha_from_unified(values: Mapping[str, float]) -> dict[str, float]:
    """Return the inverse of `unified_from_alpha`."""
    alpha = values["xi"] / (1 + values["xi"])
    return {**values, "alpha": alpha, "fx": values["fx"] * (1 - alpha), "fy": values["fy"] * (1 - alpha)}
