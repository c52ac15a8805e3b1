"""mrcal's .cameramodel."""

import re
from collections.abc import Mapping

from omnisight.camera import Camera
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._limits import HEAD_CHARS
from omnisight.formats._readers import Reader
from omnisight.formats._values import build_with_zeros, image_size, numbers
from omnisight.formats._yaml import flow, read_map

TITLE = "mrcal cameramodel"
SUFFIX = ".cameramodel"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; extrinsics are Rodrigues, then translation"
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
# The pose of the camera, cam_from_ref. mrcal 2.5 writes the first name; every release reads the second.
KEPT = ("rt_cam_ref", "extrinsics")
FIELD = re.compile(r"""["']lensmodel["']\s*:""")
COMMENT = "# {}"
FLAT = Reader("mrcal 2.2", 90, "projects points to the opposite side of the image, without a flag")
WIDE = Reader("mrcal 2.2")
READERS = dict.fromkeys(MODELS, FLAT) | dict.fromkeys(("stereographic", "equirectangular"), WIDE)


def matches(text: str) -> bool:
    """Return whether this is a dictionary with a `lensmodel`."""
    return FIELD.search(text) is not None and '"omnisight' not in text[:HEAD_CHARS]


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera; the text is a Python literal, which is never evaluated."""
    data = read_map(text)
    kind = str(data["lensmodel"])
    if kind not in LENSES:
        raise ValueError(
            f"unknown lensmodel {kind[:60]!r}; known are {', '.join(LENSES)}. Convert with mrcal-convert-lensmodel"
        )
    model, names = LENSES[kind]
    names = names.split()
    values = dict(zip(names, numbers(data.get("intrinsics"), f"{kind} intrinsics", len(names)), strict=True))
    size = image_size(*numbers(data.get("imagersize"), "imagersize", 2))
    return {"camera": Camera(build_with_zeros(model, values), size, extra=unknown_fields(data, KNOWN))}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the pose that its file held."""
    kind, names = next(
        ((kind, names) for kind, (model, names) in LENSES.items() if model == camera.model.name), ("", "")
    )
    exported = export(camera, MODELS, names.split())
    pose = next((camera.extra[key] for key in KEPT if key in camera.extra), [0.0] * 6)
    fields = {
        "lensmodel": f"'{kind}'",
        "intrinsics": flow([exported.values[name] for name in names.split()]),
        "imagersize": flow(list(exported.size)),
        "extrinsics": flow(pose),
    }
    body = "".join(f"    '{key}': {value},\n" for key, value in fields.items())
    return exported.result(f"{{\n{body}}}\n", KEPT)
