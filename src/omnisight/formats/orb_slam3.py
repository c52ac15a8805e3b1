"""ORB-SLAM's settings yaml, of ORB-SLAM3 1.0 and before.

Integer pixel = pixel centre; lengths in px. KannalaBrandt8 has OpenCV's k1 ... k4 of a fisheye, PinHole OpenCV's k1 k2
p1 p2 k3. Read as `Examples/*/*.yaml` of ORB-SLAM3 are written: `Camera1.fx` and `Camera2.fx` since 1.0, `Camera.fx`
before; a file of ORB-SLAM2 names no type and is a pinhole's.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import flow, read_map

TITLE = "ORB-SLAM3 settings yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; every number but the size is written with a point"
)
PLANE = ("fx", "fy", "cx", "cy")
FISHEYE = ("k1", "k2", "k3", "k4")
BROWN = ("k1", "k2", "p1", "p2", "k3")
# Our model: its type, and the names it writes. A pinhole with coefficients is our radial_tangential.
LENSES = {
    "kannala_brandt": ("KannalaBrandt8", FISHEYE),
    "radial_tangential": ("PinHole", BROWN),
    "pinhole": ("PinHole", ()),
}
MODELS = tuple(LENSES)
TYPES = {"kannalabrandt8": FISHEYE, "pinhole": BROWN, "rectified": ()}
FOCAL = re.compile(r"^Camera1?\.fx[ \t]*:", re.MULTILINE)
OTHERS = re.compile(r"^Camera\.model[ \t]*:", re.MULTILINE)  # openvslam's


def matches(text: str) -> bool:
    """Say whether a line begins with `Camera1.fx:` or `Camera.fx:`, and none with `Camera.model:`."""
    head = text[:1_000_000]
    return FOCAL.search(head) is not None and OTHERS.search(head) is None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or both of a stereo pair."""
    data = read_map(text)
    kind = str(data.get("Camera.type", "PinHole"))
    if kind.lower() not in TYPES:
        raise ValueError(f"no Camera.type {kind[:30]!r}; there are KannalaBrandt8, PinHole, Rectified")
    # 1.0 refuses a file without a size; before, it was optional.
    size = (0, 0)
    if "Camera1.fx" in data or "Camera.width" in data:
        size = picture_size(data.get("Camera.width"), data.get("Camera.height"))
    lefts = "Camera1" if "Camera1.fx" in data else "Camera"
    heads = {lefts: "camera1"} | ({"Camera2": "camera2"} if "Camera2.fx" in data else {})
    used = {"Camera.type", "Camera.width", "Camera.height"}
    models = {name: _model(data, head, kind.lower(), used) for head, name in heads.items()}
    extra = note_unknown(data, used)
    return {name: Camera(model, size, extra=extra) for name, model in models.items()}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the camera's part of a settings file, as of 1.0."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind, own = LENSES[camera.model.name]
    camera, notes = without(camera, [*PLANE, *own])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    lines = ["%YAML:1.0", "", 'File.version: "1.0"', "", f'Camera.type: "{kind}"', ""]
    # The coefficients come first, so that a file cut off is not taken for a pinhole's.
    lines += [f"Camera1.{name}: {flow(values[name])}" for name in (*own, *PLANE)]
    lines += ["", f"Camera.width: {size[0]}", f"Camera.height: {size[1]}"]
    notes += ("add Camera.fps, Camera.RGB and the ORBextractor and Viewer parts of one of its examples",)
    return "\n".join(lines) + "\n", notes + left_out(camera)


def _model(data: Mapping[str, Any], head: str, kind: str, used: set[str]) -> Any:
    own = TYPES[kind]
    given = {name: data[f"{head}.{name}"] for name in (*PLANE, *own) if data.get(f"{head}.{name}") is not None}
    used |= {f"{head}.{name}" for name in given}
    needed = (*PLANE, *(own if own == FISHEYE else ()))
    if missing := [f"{head}.{name}" for name in needed if name not in given]:
        raise ValueError(f"{', '.join(missing)} missing")
    if own == FISHEYE:
        return build("kannala_brandt", given)
    if any(name in given for name in own):
        return build("radial_tangential", dict.fromkeys(BROWN, 0.0) | given)
    return build("pinhole", given | {"skew": 0.0})
