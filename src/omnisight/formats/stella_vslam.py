"""The yaml of stella_vslam, and of OpenVSLAM before it.

Integer pixel = pixel centre; lengths in px. `perspective` has OpenCV's k1 k2 p1 p2 k3, `fisheye` OpenCV's k1 ... k4 of
a fisheye, `radial_division` Fitzgibbon's parameter as `distortion` (undistorted = distorted/(1 + distortion r^2), as
`radial_division.cc` has it). OpenVSLAM writes the names flat, `Camera.fx`.

`equirectangular` is the whole sphere of cols x rows. stella_vslam itself takes longitude 0 to be at cols/2 of keypoints
that are counted from pixel centres, half a pixel right of the image's middle; here it is in the middle.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import (
    build,
    is_whole_sphere,
    left_out,
    picture_size,
    refuse,
    whole_sphere,
    with_size,
    without,
)
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import flow, read_map

TITLE = "stella_vslam yaml"
SUFFIX = ".yaml"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; cols is the width, rows the height"
PLANE = {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"}
# Its model: ours, and ours and its names of the coefficients.
LENSES: dict[str, tuple[str, dict[str, str]]] = {
    "fisheye": ("kannala_brandt", {k: k for k in ("k1", "k2", "k3", "k4")}),
    "perspective": ("radial_tangential", {k: k for k in ("k1", "k2", "p1", "p2", "k3")}),
    "radial_division": ("division", {"k": "distortion"}),
    "equirectangular": ("equirectangular", {}),
}
MODELS = tuple(model for model, _ in LENSES.values())
HEAD = "Camera."
FLAT = re.compile(r"^Camera\.model[ \t]*:", re.MULTILINE)
NESTED = re.compile(r"^Camera[ \t]*:[ \t]*\n(?:(?:[ \t]+\S[^\n]*|[ \t]*|#[^\n]*)\n)*?[ \t]+model[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether there is a `Camera:` with a `model:` below it, or `Camera.model:`."""
    head = text[:100_000].replace("\r\n", "\n")
    return FLAT.search(head) is not None or NESTED.search(head) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    given = data.get("Camera")
    beside = note_unknown(data, {"Camera"})
    if given is None:
        given = {key[len(HEAD) :]: value for key, value in data.items() if key.startswith(HEAD)}
        beside = {key: value for key, value in data.items() if not key.startswith(HEAD)}
    if not isinstance(given, dict):
        raise ValueError("Camera must hold names and values")
    kind = given.get("model")
    if kind not in LENSES:
        raise ValueError(f"no Camera model {kind!r:.40}; there are {', '.join(LENSES)}")
    model, own = LENSES[kind]
    size = picture_size(given.get("cols"), given.get("rows"))
    used = {"model", "cols", "rows"}
    if kind == "equirectangular":
        values = whole_sphere(size)
    else:
        names = PLANE | own
        used |= set(names.values())
        if missing := [theirs for theirs in names.values() if given.get(theirs) is None]:
            raise ValueError(f"{', '.join(missing)} missing; {kind} has {', '.join(names.values())}")
        values = {ours: given[theirs] for ours, theirs in names.items()}
    extra = beside | note_unknown(given, used)
    name = given.get("name")
    return {str(name) if name else "camera": Camera(build(model, values), size, extra=extra)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of the camera's part of a configuration."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind, own = next((kind, own) for kind, (model, own) in LENSES.items() if model == camera.model.name)
    fields: dict[str, Any] = {"name": str(camera.extra.get("name", "camera")), "setup": "monocular", "model": kind}
    notes: tuple[str, ...] = ()
    if kind == "equirectangular":
        is_whole_sphere(camera)
    else:
        camera, notes = without(camera, [*PLANE, *own])
        values: dict[str, Any] = camera.model.to_dict()
        build(camera.model.name, values)
        fields |= {theirs: values[ours] for ours, theirs in (PLANE | own).items()}
    fields |= {"cols": size[0], "rows": size[1], "fps": 30.0, "color_order": "RGB"}
    kept = ("setup", "fps", "color_order", "focal_x_baseline", "depth_threshold")
    fields |= {key: camera.extra[key] for key in kept if key in camera.extra}
    lines = [
        "Camera:",
        *(f"  {key}: {value if isinstance(value, str) else flow(value)}" for key, value in fields.items()),
    ]
    return "\n".join(lines) + "\n", notes + left_out(camera, ("name", *kept))
