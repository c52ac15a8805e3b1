"""The little yaml files of fisheye-calib-adapter."""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, numbers, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._scaramuzza import model_of_xy
from omnisight.formats._yaml import flow, read_map
from omnisight.models import CameraModel

TITLE = "fisheye-calib-adapter yaml"
SUFFIX = ".yml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; the model is told by the names of its parameters"
)
PLANE = ("fx", "fy", "cx", "cy")
LENSES = {
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "double_sphere": ("alpha", "xi"),
    "eucm": ("alpha", "beta"),
    "radial_tangential": ("k1", "k2", "k3", "p1", "p2"),
    "unified": ("alpha",),
    "pinhole": (),
}
MODELS = tuple(LENSES)
STRETCH = ("c", "d", "e", "cx", "cy", "coefficients")
FIELDS = re.compile(r"^image[ \t]*:", re.MULTILINE), re.compile(r"^parameter[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether lines begin with `image:` and `parameter:`."""
    return all(field.search(text[:1_000_000]) for field in FIELDS)


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    image, given = data["image"], data["parameter"]
    if not isinstance(image, dict) or not isinstance(given, dict):
        raise ValueError("image and parameter must hold names and values")
    size = picture_size(image.get("width"), image.get("height"))
    extra = note_unknown(data, {"image", "parameter"}) | note_unknown(image, {"width", "height"})
    if set(given) == set(STRETCH):
        return {"camera": Camera(_ocam(given), size, extra=extra)}
    model = next((model for model, own in LENSES.items() if {*PLANE, *own} == set(given)), None)
    if model is None:
        raise ValueError(f"no model has the parameters {', '.join(given)}")
    values = {key: number(value, key) for key, value in given.items()}
    if model == "unified":
        alpha = values.pop("alpha")
        if not alpha < 1:
            raise ValueError(f"alpha of the unified model must be below 1, got {alpha:g}")
        values |= {"xi": alpha / (1 - alpha), "fx": values["fx"] / (1 - alpha), "fy": values["fy"] / (1 - alpha)}
    return {"camera": Camera(build(model, values), size, extra=extra)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    camera, notes = without(camera, [n for n in camera.model.param_names if n != "skew"])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    if camera.model.name == "unified":
        alpha = values["xi"] / (1 + values["xi"])
        values |= {"alpha": alpha, "fx": values["fx"] * (1 - alpha), "fy": values["fy"] * (1 - alpha)}
    lines = ["image:", f"  width: {width}", f"  height: {height}", "parameter:"]
    # The model's own come first, so that a file cut off is not taken for a pinhole's.
    lines += [f"  {name}: {flow(values[name])}" for name in (*LENSES[camera.model.name], *PLANE)]
    return "\n".join(lines) + "\n", notes + left_out(camera)


def _ocam(given: Mapping[str, Any]) -> CameraModel:
    """Make our model from one whose stretch [c d; e 1] acts on x, y instead of row, column."""
    unprojection = given["coefficients"].get("unprojection") if isinstance(given["coefficients"], dict) else None
    plane = {name: number(given[name], name) for name in ("c", "d", "e", "cx", "cy")}
    return model_of_xy(numbers(unprojection, "unprojection"), **plane)
