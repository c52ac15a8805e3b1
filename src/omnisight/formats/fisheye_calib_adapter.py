"""The yaml files of fisheye-calib-adapter."""

from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import model_of_xy
from omnisight.formats._values import (
    alpha_from_unified,
    build,
    image_size,
    mapping,
    number,
    numbers,
    unified_from_alpha,
)
from omnisight.formats._yaml import flow, read_map
from omnisight.models import CameraModel

TITLE = "fisheye-calib-adapter yaml"
SUFFIX = ".yml"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; the parameter names determine the model"
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
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether lines begin with `image:` and `parameter:`."""
    return has_lines(text, "image", "parameter")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    image, given = mapping(data["image"], "image"), mapping(data["parameter"], "parameter")
    size = image_size(image.get("width"), image.get("height"))
    extra = unknown_fields(data, {"image", "parameter"}) | unknown_fields(image, {"width", "height"})
    if set(given) == set(STRETCH):
        return {"camera": Camera(_ocam(given), size, extra=extra)}
    model = next((model for model, own in LENSES.items() if {*PLANE, *own} == set(given)), None)
    if model is None:
        raise ValueError(f"no model has the parameters {', '.join(given)}")
    values = {key: number(value, key) for key, value in given.items()}
    if model == "unified":
        values = unified_from_alpha(values)
    return {"camera": Camera(build(model, values), size, extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera."""
    exported = export(camera, MODELS)
    width, height = exported.size
    values = alpha_from_unified(exported.values) if camera.model.name == "unified" else exported.values
    lines = ["image:", f"  width: {width}", f"  height: {height}", "parameter:"]
    # The coefficients come first: a truncated file must not read as a pinhole.
    lines += [f"  {name}: {flow(values[name])}" for name in (*LENSES[camera.model.name], *PLANE)]
    return exported.result("\n".join(lines) + "\n")


def _ocam(given: Mapping[str, Any]) -> CameraModel:
    """Return the ocam model of parameters whose stretch [c d; e 1] acts on x, y instead of row, column."""
    unprojection = given["coefficients"].get("unprojection") if isinstance(given["coefficients"], dict) else None
    plane = {name: number(given[name], name) for name in ("c", "d", "e", "cx", "cy")}
    return model_of_xy(numbers(unprojection, "unprojection"), **plane)
