"""What every format asks of the numbers it reads and of the camera it writes."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models import CameraModel, model_class
from omnisight.models._parametric import Parametric
from omnisight.models.ocam import Ocam

Array = NDArray[np.float64]

WIDEST = 1_000_000  # px
SHORTEST, LONGEST = 1e-6, 1e7  # px, of a focal length
LARGEST = 1e12  # of any parameter: beyond it products overflow
SMALLEST = 1e-150  # of any parameter but 0, as which less counts: squares underflow
MOST_TERMS = 20  # of Scaramuzza's f(r), which is compiled for their number; OCamCalib's own cameras have 4
MAY_DIFFER_PX = 0.5


def number(value: Any, name: str) -> float:
    """Give a number of a file, or refuse what is none, not finite or absurd."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
        raise ValueError(f"{name} must be a number, got {value!r}")
    return float(value) if abs(value) >= SMALLEST else 0.0


def numbers(values: Any, name: str, count: int | None = None) -> list[float]:
    """Give a list of numbers, of that length if one is asked."""
    if not isinstance(values, list) or (count is not None and len(values) != count):
        found = f"{len(values)}" if isinstance(values, list) else repr(values)
        raise ValueError(f"{name} must be a list of {'' if count is None else f'{count} '}numbers, got {found}")
    return [number(value, f"{name}[{i}]") for i, value in enumerate(values)]


def picture_size(width: Any, height: Any) -> tuple[int, int]:
    """Give the size of the image; a tool may have written it as 640.0."""
    sides = [number(side, name) for side, name in ((width, "image width"), (height, "image height"))]
    for side, name in zip(sides, ("width", "height"), strict=True):
        if side != int(side) or not 1 <= side <= WIDEST:
            raise ValueError(f"image {name} must be a whole number from 1 to {WIDEST}, got {side:g}")
    return int(sides[0]), int(sides[1])


def build(model: str, values: Mapping[str, Any]) -> CameraModel:
    """Make a camera model from its parameters by name, inside the bounds of each, its focal length positive."""
    for name in ("fx", "fy", "a0"):
        if name in values and not 0 < number(values[name], name) <= LONGEST:
            raise ValueError(f"{name} (focal length, px) must be positive and below {LONGEST:g}, got {values[name]:g}")
    return build_mirrored(model, values)


def build_mirrored(model: str, values: Mapping[str, Any]) -> CameraModel:
    """Do it for a camera that may show the world in a mirror: its focal length is negative then."""
    made = model_class(model).from_dict({name: number(value, name) for name, value in values.items()})
    must_be_possible(made)
    return made


def must_be_possible(made: CameraModel) -> None:
    """Refuse a camera model of numbers that no camera has."""
    if isinstance(made, Ocam):
        must_be_few(len(made.a))
    values = made.to_dict()
    for name in ("fx", "fy", "a0"):
        if name in values and abs(values[name]) < SHORTEST:
            raise ValueError(f"{name} (focal length, px) must be {SHORTEST:g} or longer, got {values[name]:g}")
    must_be_bounded(made)
    try:
        # What projects and what does not is worked out once: numbers that overflow do it there.
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            _ = made.kernel
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        given = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        raise ValueError(
            f"no {made.name} camera has these numbers ({error}): {given:.300}; is the file damaged? Save it again with"
            " the program that made it"
        ) from error


def must_be_bounded(made: Parametric) -> None:
    """Refuse a parameter outside of its bounds."""
    for parameter, value in zip(made.parameters, made.params, strict=True):
        if not parameter.low <= value <= parameter.high:
            raise ValueError(f"{parameter.name} must lie in [{parameter.low:g}, {parameter.high:g}], got {value:g}")


def must_be_few(terms: int) -> None:
    """Refuse more coefficients of Scaramuzza's f(r) than any camera has."""
    if terms > MOST_TERMS:
        raise ValueError(
            f"f(r) has {terms} coefficients, {MOST_TERMS} are the most that a camera needs: is the file damaged?"
            " Calibrate with a polynomial of lower degree"
        )


def with_size(camera: Camera) -> tuple[int, int]:
    """Give the size of the image, or say that this format cannot do without."""
    if not all(camera.size):
        raise ValueError("the image's size is not known, and this format needs it")
    return picture_size(*camera.size)


def left_out(camera: Camera, kept: Sequence[str] = ()) -> tuple[str, ...]:
    """Say what of a camera a file of another tool does not hold."""
    lost = ["the calibrated cone"] if camera.theta_max is not None else []
    lost += ["the calibration's figures"] if camera.calibration else []
    lost += ["the covariance"] if camera.covariance is not None else []
    lost += [key for key in camera.extra if key not in kept]
    return (f"not held: {', '.join(lost)}",) if lost else ()


def without(camera: Camera, held: Sequence[str]) -> tuple[Camera, tuple[str, ...]]:
    """Give the camera with only the parameters that a format holds, and a sentence if that changed it.

    A parameter that the format lacks (a skew, a third coefficient) is zero in most cameras. If it is not, the others
    are fitted to make up for it, as long as they can.
    """
    lacking = [name for name, value in camera.model.to_dict().items() if name not in held and value != 0]
    if not lacking:
        return camera, ()
    said = f"the format has no {' and no '.join(lacking)} of {camera.model.name}"
    with_size(camera)
    bearings, pixels = camera.samples()
    model = type(camera.model).fit(bearings, pixels, fixed=[n for n in camera.model.param_names if n not in held])
    error = difference(model, bearings, pixels)
    if not error <= MAY_DIFFER_PX:
        raise ValueError(f"{said}, and without the camera is {error:.2g} px off: convert it to another --model")
    return dataclasses.replace(camera, model=model), (f"{said}: fitted without, {error:.2g} px off at most",)


def with_one_focal(camera: Camera) -> tuple[Camera, tuple[str, ...]]:
    """Give the camera with one focal length for both directions, and a sentence if that changed it."""
    values = camera.model.to_dict()
    if values["fx"] == values["fy"]:
        return camera, ()
    said = f"the format has one focal length and this camera has two, {values['fx']:.6g} and {values['fy']:.6g}"
    with_size(camera)
    model = camera.model.with_values(dict.fromkeys(("fx", "fy"), (values["fx"] + values["fy"]) / 2))
    error = difference(model, *camera.samples())
    if not error <= MAY_DIFFER_PX:
        raise ValueError(f"{said}: their mean is {error:.2g} px off; choose a format that has both")
    return dataclasses.replace(camera, model=model), (f"{said}: their mean is written, {error:.2g} px off at most",)


def whole_sphere(size: tuple[int, int]) -> dict[str, float]:
    """Give the parameters of an equirectangular image of the whole sphere, forward in its middle."""
    middle = {"cx": (size[0] - 1) / 2, "cy": (size[1] - 1) / 2}
    return {"fx": size[0] / (2 * math.pi), "fy": size[1] / math.pi, **middle}


def is_whole_sphere(camera: Camera) -> None:
    """Refuse an equirectangular camera that is not the whole sphere with forward in the middle."""
    whole = whole_sphere(with_size(camera))
    if any(abs(value - whole[key]) > 1e-9 * camera.width for key, value in camera.model.to_dict().items()):
        raise ValueError("equirectangular is the whole sphere with forward in the middle, which this camera is not")


def difference(model: CameraModel, bearings: Array, pixels: Array) -> float:
    """Give how far (px) a model's pixels are from these at most; inf where it has none."""
    seen, valid = model.project_numpy(bearings)
    return float(np.linalg.norm(seen - pixels, axis=1).max()) if len(seen) and valid.all() else np.inf


def refuse(camera: Camera, models: Sequence[str], advice: str = "") -> None:
    """Refuse a camera of a model that the format has not."""
    if camera.model.name not in models:
        hint = advice or f"convert it with --model {models[0]}"
        raise ValueError(f"has no model {camera.model.name}; it has {', '.join(models)}: {hint}")
