"""mrcal's .cameramodel."""

import re
from collections.abc import Mapping

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, numbers, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import flow, read_map

TITLE = "mrcal cameramodel"
SUFFIX = ".cameramodel"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; rt_cam_ref is Rodrigues, then translation"
PLANE = "fx fy cx cy"
LENSES = {
    "LENSMODEL_OPENCV8": ("rational", f"{PLANE} k1 k2 p1 p2 k3 k4 k5 k6"),
    "LENSMODEL_OPENCV5": ("radial_tangential", f"{PLANE} k1 k2 p1 p2 k3"),
    "LENSMODEL_OPENCV4": ("radial_tangential", f"{PLANE} k1 k2 p1 p2"),
    "LENSMODEL_PINHOLE": ("pinhole", PLANE),
    "LENSMODEL_STEREOGRAPHIC": ("stereographic", PLANE),
    "LENSMODEL_LONLAT": ("equirectangular", PLANE),
}
MODELS = tuple(dict.fromkeys(model for model, _ in LENSES.values()))
KNOWN = {"lensmodel", "intrinsics", "imagersize"}
KEPT = ("rt_cam_ref", "extrinsics")
FIELD = re.compile(r"""["']lensmodel["']\s*:""")


def matches(text: str) -> bool:
    """Say whether this is a dictionary with a `lensmodel`."""
    return FIELD.search(text) is not None and '"omnisight' not in text[:2000]


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera: the text is a Python literal, and never evaluated."""
    data = read_map(text)
    kind = str(data["lensmodel"])
    if kind not in LENSES:
        raise ValueError(
            f"no lensmodel {kind[:60]!r}; there are {', '.join(LENSES)}. mrcal-convert-lensmodel makes these"
        )
    model, names = LENSES[kind]
    names = names.split()
    values = dict(zip(names, numbers(data.get("intrinsics"), f"{kind} intrinsics", len(names)), strict=True))
    if model == "radial_tangential":
        values.setdefault("k3", 0.0)
    size = picture_size(*numbers(data.get("imagersize"), "imagersize", 2))
    return {"camera": Camera(build(model, values), size, extra=note_unknown(data, KNOWN))}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with the pose that the camera's file held or none."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind, names = next((kind, names) for kind, (model, names) in LENSES.items() if model == camera.model.name)
    camera, notes = without(camera, names.split())
    values = camera.model.to_dict()
    build(camera.model.name, values)
    pose = next((key for key in KEPT if key in camera.extra), "rt_cam_ref")
    fields = {
        "lensmodel": f"'{kind}'",
        "intrinsics": flow([values[name] for name in names.split()]),
        "imagersize": flow(list(size)),
        pose: flow(camera.extra.get(pose, [0.0] * 6)),
    }
    body = "".join(f"    '{key}': {value},\n" for key, value in fields.items())
    return f"{{\n{body}}}\n", notes + left_out(camera, KEPT)
