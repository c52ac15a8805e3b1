"""The yaml of stella_vslam, and of OpenVSLAM before it.

Integer pixel = pixel centre; lengths in px. `perspective` has OpenCV's k1 k2 p1 p2 k3, `fisheye` OpenCV's k1 ... k4 of
a fisheye, `radial_division` Fitzgibbon's parameter as `distortion` (undistorted = distorted/(1 + distortion r^2), see
`radial_division.cc`). OpenVSLAM writes flat keys, `Camera.fx`.

`equirectangular` is the whole sphere of cols x rows. stella_vslam itself puts longitude 0 at cols/2 of keypoints whose
origin is a pixel centre, half a pixel right of the image centre; here it is in the centre.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import check_whole_sphere, export, kept_fields, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._values import build, image_size, mapping, whole_sphere
from omnisight.formats._yaml import flow, read_map

TITLE = "stella_vslam yaml"
SUFFIX = ".yaml"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; cols is the width, rows the height"
PLANE = {"fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"}
# The model: ours, and for each coefficient our name and the name here.
LENSES: dict[str, tuple[str, dict[str, str]]] = {
    "fisheye": ("kannala_brandt", {k: k for k in ("k1", "k2", "k3", "k4")}),
    "perspective": ("radial_tangential", {k: k for k in ("k1", "k2", "p1", "p2", "k3")}),
    "radial_division": ("division", {"k": "distortion"}),
    "equirectangular": ("equirectangular", {}),
}
MODELS = tuple(model for model, _ in LENSES.values())
FLAT_PREFIX = "Camera."
MAX_SEARCHED_CHARS = 100_000  # NESTED takes longer than a search for a key
KEPT = ("setup", "fps", "color_order", "focal_x_baseline", "depth_threshold")
NESTED = re.compile(r"^Camera[ \t]*:[ \t]*\n(?:(?:[ \t]+\S[^\n]*|[ \t]*|#[^\n]*)\n)*?[ \t]+model[ \t]*:", re.MULTILINE)
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether there is a `Camera:` with a `model:` below it, or `Camera.model:`."""
    head = text[:MAX_SEARCHED_CHARS].replace("\r\n", "\n")
    return has_lines(head, r"Camera\.model") or NESTED.search(head) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    flat = {key: value for key, value in data.items() if key.startswith(FLAT_PREFIX)}
    given = data.get("Camera")
    if given is None:
        given = {key.removeprefix(FLAT_PREFIX): value for key, value in flat.items()}
        others = unknown_fields(data, flat)
    else:
        given, others = mapping(given, "Camera"), unknown_fields(data, {"Camera"})
    kind = given.get("model")
    if kind not in LENSES:
        raise ValueError(f"unknown Camera model {kind!r:.40}; known are {', '.join(LENSES)}")
    model, own = LENSES[kind]
    size = image_size(given.get("cols"), given.get("rows"))
    used = {"model", "cols", "rows"}
    if kind == "equirectangular":
        values = whole_sphere(size)
    else:
        names = PLANE | own
        used |= set(names.values())
        if missing := [theirs for theirs in names.values() if given.get(theirs) is None]:
            raise ValueError(f"{', '.join(missing)} missing; {kind} has {', '.join(names.values())}")
        values = {ours: given[theirs] for ours, theirs in names.items()}
    extra = others | unknown_fields(given, used)
    return {str(given.get("name") or "camera"): Camera(build(model, values), size, extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the camera section of a configuration."""
    kind, own = next(
        ((kind, own) for kind, (model, own) in LENSES.items() if model == camera.model.name), ("", dict[str, str]())
    )
    exported = export(camera, MODELS, [*PLANE, *own])
    size = exported.size
    fields: dict[str, Any] = {"name": str(camera.extra.get("name", "camera")), "setup": "monocular", "model": kind}
    if kind == "equirectangular":
        check_whole_sphere(camera)
    else:
        fields |= {theirs: exported.values[ours] for ours, theirs in (PLANE | own).items()}
    fields |= {"cols": size[0], "rows": size[1], "fps": 30.0, "color_order": "RGB"}
    fields |= kept_fields(camera, KEPT)
    lines = [
        "Camera:",
        *(f"  {key}: {value if isinstance(value, str) else flow(value)}" for key, value in fields.items()),
    ]
    return exported.result("\n".join(lines) + "\n", ("name", *KEPT))
