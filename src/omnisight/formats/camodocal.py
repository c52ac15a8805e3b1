"""CamOdoCal's yaml, which VINS-Mono and KITTI-360 use."""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import flow, read_map

TITLE = "CamOdoCal yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; KANNALA_BRANDT's k2 ... k5 are OpenCV's k1 ... k4"
)

# Its model: ours, and for each of its groups its names and ours.
DISTORTION = ("distortion_parameters", {"k1": "k1", "k2": "k2", "p1": "p1", "p2": "p2"})
FISHEYE = {"k2": "k1", "k3": "k2", "k4": "k3", "k5": "k4"}
LENSES: dict[str, tuple[str, tuple[tuple[str, dict[str, str]], ...]]] = {
    "KANNALA_BRANDT": (
        "kannala_brandt",
        (("projection_parameters", {**FISHEYE, "mu": "fx", "mv": "fy", "u0": "cx", "v0": "cy"}),),
    ),
    "MEI": (
        "mei",
        (
            ("mirror_parameters", {"xi": "xi"}),
            DISTORTION,
            ("projection_parameters", {"gamma1": "fx", "gamma2": "fy", "u0": "cx", "v0": "cy"}),
        ),
    ),
    "PINHOLE": (
        "radial_tangential",
        (DISTORTION, ("projection_parameters", {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"})),
    ),
}
MODELS = tuple(model for model, _ in LENSES.values())
KNOWN = {"model_type", "image_width", "image_height"} | {group for _, groups in LENSES.values() for group, _ in groups}
TYPE = re.compile(r"^model_type[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether a line begins with `model_type:`."""
    return TYPE.search(text[:1_000_000]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    kind = str(data["model_type"]).upper()
    if kind == "SCARAMUZZA":
        raise ValueError(
            "SCARAMUZZA files do not agree on which axis x is; use the calib_results.txt they were made from"
        )
    if kind not in LENSES:
        raise ValueError(f"no model_type {kind[:30]!r}; there are {', '.join(LENSES)}")
    model, groups = LENSES[kind]
    values: dict[str, Any] = {"k3": 0.0} if model == "radial_tangential" else {}
    unknown: dict[str, Any] = {}
    for group, names in groups:
        given = data.get(group)
        if not isinstance(given, dict) or not set(names) <= set(given):
            raise ValueError(f"{group} must hold {', '.join(names)}")
        values |= {ours: given[theirs] for theirs, ours in names.items()}
        if beside := note_unknown(given, set(names)):
            unknown[group] = beside
    size = picture_size(data.get("image_width"), data.get("image_height"))
    name = str(data.get("camera_name") or "camera")
    return {name: Camera(build(model, values), size, extra=note_unknown(data, KNOWN) | unknown)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind = next(kind for kind, (model, _) in LENSES.items() if model == camera.model.name)
    groups = LENSES[kind][1]
    camera, notes = without(camera, [ours for _, names in groups for ours in names.values()])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    lines = ["%YAML:1.0", "---", f"model_type: {kind}"]
    lines += [f"camera_name: {flow(str(camera.extra.get('camera_name', 'camera')))}"]
    lines += [f"image_width: {size[0]}", f"image_height: {size[1]}"]
    for group, names in groups:
        lines += [f"{group}:", *(f"   {theirs}: {flow(values[ours])}" for theirs, ours in names.items())]
    return "\n".join(lines) + "\n", notes + left_out(camera, ("camera_name",))
