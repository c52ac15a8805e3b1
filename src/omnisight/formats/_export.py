"""Prepare a camera for a format that holds only part of it."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._values import build, image_size, whole_sphere
from omnisight.models import CameraModel

Array = NDArray[np.float64]

MAX_REFIT_ERROR_PX = 0.5  # beyond it the written file would be another camera


@dataclass(frozen=True)
class Export:
    """A camera whose model, image size and parameters a format holds.

    Attributes
    ----------
    camera
        The camera, refitted if the format lacks one of its parameters.
    size
        (width, height), px.
    values
        The parameters by name.
    notes
        What was changed, one sentence each.
    """

    camera: Camera
    size: tuple[int, int]
    values: dict[str, Any]
    notes: tuple[str, ...]

    def result(self, text: str, kept: Iterable[str] = ()) -> tuple[str, tuple[str, ...]]:
        """Return the text of a file with all notes; `kept` names the extra values that the file holds."""
        return text, self.notes + dropped_fields(self.camera, kept)


def export(camera: Camera, models: Sequence[str], held: Iterable[str] | None = None) -> Export:
    """Check that a format holds a camera, and refit the camera without the parameters that the format lacks.

    Parameters
    ----------
    camera
        The camera.
    models
        The models of the format.
    held
        The parameters that the format holds; by default all of them except a skew.

    Raises
    ------
    ValueError
        If the format lacks the model, the image size is unknown or a parameter cannot be left out.
    """
    check_supported(camera, models)
    size = known_size(camera)
    if held is None:
        held = [name for name in camera.model.param_names if name != "skew"]
    camera, notes = refit_without(camera, set(held))
    values = camera.model.to_dict()
    build(camera.model.name, values)
    return Export(camera, size, values, notes)


def check_supported(camera: Camera, models: Sequence[str]) -> None:
    """Raise ValueError if a format lacks the camera's model."""
    if camera.model.name not in models:
        raise ValueError(
            f"has no model {camera.model.name}; it has {', '.join(models)}: convert the camera to"
            f" {models[0]} first (omnisight convert --model {models[0]})"
        )


def known_size(camera: Camera) -> tuple[int, int]:
    """Return the image size; raise ValueError if it is unknown."""
    if not all(camera.size):
        raise ValueError("the image size is not known, and this format needs it")
    return image_size(*camera.size)


def refit_without(camera: Camera, held: Iterable[str]) -> tuple[Camera, tuple[str, ...]]:
    """Return the camera with only the parameters that a format holds, and a note if that changed it.

    A parameter that the format lacks (a skew, a third coefficient) is zero in most cameras. If it is not, the other
    parameters are refitted without it.
    """
    held = set(held)
    lacking = [name for name, value in camera.model.to_dict().items() if name not in held and value != 0]
    if not lacking:
        return camera, ()
    reason = f"the format has no {' and no '.join(lacking)} of {camera.model.name}"
    known_size(camera)
    bearings, pixels = camera.samples()
    model = type(camera.model).fit(bearings, pixels, fixed=[n for n in camera.model.param_names if n not in held])
    error = max_difference_px(model, bearings, pixels)
    if not error <= MAX_REFIT_ERROR_PX:
        raise ValueError(f"{reason}, and without it the camera is {error:.2g} px off: convert it to another --model")
    return dataclasses.replace(camera, model=model), (f"{reason}: refitted without it, at most {error:.2g} px off",)


def with_mean_focal(camera: Camera) -> tuple[Camera, tuple[str, ...]]:
    """Return the camera with the mean of its two focal lengths, and a note if that changed it."""
    values = camera.model.to_dict()
    if values["fx"] == values["fy"]:
        return camera, ()
    reason = f"the format has one focal length and this camera has two, {values['fx']:.6g} and {values['fy']:.6g}"
    known_size(camera)
    model = camera.model.with_values(dict.fromkeys(("fx", "fy"), (values["fx"] + values["fy"]) / 2))
    error = max_difference_px(model, *camera.samples())
    if not error <= MAX_REFIT_ERROR_PX:
        raise ValueError(f"{reason}: their mean is {error:.2g} px off; choose a format that has both")
    return dataclasses.replace(camera, model=model), (f"{reason}: their mean is written, at most {error:.2g} px off",)


def check_whole_sphere(camera: Camera) -> None:
    """Raise ValueError if an equirectangular camera is not the whole sphere with forward in the centre."""
    whole = whole_sphere(known_size(camera))
    if any(abs(value - whole[key]) > 1e-9 * camera.width for key, value in camera.model.to_dict().items()):
        raise ValueError("equirectangular is the whole sphere with forward in the centre, which this camera is not")


def max_difference_px(model: CameraModel, bearings: Array, pixels: Array) -> float:
    """Return the largest distance (px) between a model's pixels and these; inf where the model is not valid."""
    projected, valid = model.project_numpy(bearings)
    return float(np.linalg.norm(projected - pixels, axis=1).max()) if len(projected) and valid.all() else np.inf


def dropped_fields(camera: Camera, kept: Iterable[str] = ()) -> tuple[str, ...]:
    """Return a note on what a file of another tool does not hold, or nothing."""
    kept = set(kept)
    lost = ["the calibrated field of view"] if camera.theta_max is not None else []
    lost += ["the calibration figures"] if camera.calibration else []
    lost += ["the covariance"] if camera.covariance is not None else []
    lost += [key for key in camera.extra if key not in kept]
    return (f"not written: {', '.join(lost)}",) if lost else ()


def kept_fields(camera: Camera, names: Iterable[str]) -> dict[str, Any]:
    """Return the extra values of a camera that a format also holds."""
    return {name: camera.extra[name] for name in names if name in camera.extra}


def unknown_fields(values: Mapping[str, Any], known: Iterable[str]) -> dict[str, Any]:
    """Return what a file holds besides the known keys; it becomes the camera's `extra`."""
    known = set(known)
    return {key: value for key, value in values.items() if key not in known}
