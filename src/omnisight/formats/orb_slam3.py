"""ORB-SLAM's settings yaml, of ORB-SLAM3 1.0 and before.

Integer pixel = pixel centre; lengths in px. KannalaBrandt8 has OpenCV's k1 ... k4 of a fisheye, PinHole OpenCV's k1 k2
p1 p2 k3. As in `Examples/*/*.yaml` of ORB-SLAM3, the keys are `Camera1.fx` and `Camera2.fx` since 1.0, `Camera.fx`
before; a file of ORB-SLAM2 has no type and is a pinhole.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import make_rig, pair_of, pose_of_rows, rig_notes, rows_of_pose
from omnisight.formats._values import build, build_with_zeros, image_size
from omnisight.formats._yaml import flow, read_map
from omnisight.geometry.pose import Pose
from omnisight.models import CameraModel
from omnisight.rig import Rig

TITLE = "ORB-SLAM3 settings yaml"
SUFFIX = ".yaml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; every number but the size is written with a point;"
    " Stereo.T_c1_c2 is camera1_from_camera2"
)
PLANE = ("fx", "fy", "cx", "cy")
FISHEYE = ("k1", "k2", "k3", "k4")
BROWN = ("k1", "k2", "p1", "p2", "k3")
# Our model: the type and the coefficients. A PinHole with coefficients is our radial_tangential.
LENSES = {
    "kannala_brandt": ("KannalaBrandt8", FISHEYE),
    "radial_tangential": ("PinHole", BROWN),
    "pinhole": ("PinHole", ()),
}
MODELS = tuple(LENSES)
TYPES = {"kannalabrandt8": FISHEYE, "pinhole": BROWN, "rectified": ()}
STEREO = "Stereo.T_c1_c2"
SECTIONS = "add Camera.fps, Camera.RGB and the ORBextractor and Viewer sections of one of its examples"
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether a line begins with `Camera1.fx:` or `Camera.fx:`, and none with `Camera.model:` of OpenVSLAM."""
    return has_lines(text, r"Camera1?\.fx") and not has_lines(text, r"Camera\.model")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or both of a stereo pair."""
    data = read_map(text)
    kind = str(data.get("Camera.type", "PinHole"))
    if kind.lower() not in TYPES:
        raise ValueError(f"unknown Camera.type {kind[:30]!r}; known are KannalaBrandt8, PinHole, Rectified")
    # The size is required since 1.0 and was optional before.
    size = (0, 0)
    if "Camera1.fx" in data or "Camera.width" in data:
        size = image_size(data.get("Camera.width"), data.get("Camera.height"))
    first = "Camera1" if "Camera1.fx" in data else "Camera"
    prefixes = {first: "camera1"} | ({"Camera2": "camera2"} if "Camera2.fx" in data else {})
    used = {"Camera.type", "Camera.width", "Camera.height"}
    models = {name: _model(data, prefix, kind.lower(), used) for prefix, name in prefixes.items()}
    extra = unknown_fields(data, used)
    return {name: Camera(model, size, extra=extra) for name, model in models.items()}


def parse_rig(text: str) -> Rig:
    """Return the stereo pair of a file in the frame of its first camera."""
    cameras, data = parse(text), read_map(text)
    if len(cameras) != 2 or STEREO not in data:
        raise ValueError(f"no rig: a stereo pair has Camera1, Camera2 and {STEREO}")
    bare = [replace(camera, extra=unknown_fields(camera.extra, [STEREO])) for camera in cameras.values()]
    poses = (Pose(), pose_of_rows(data[STEREO], STEREO).inverse())
    return make_rig(dict(zip(cameras, zip(bare, poses, strict=True), strict=True)))


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the camera section of a settings file of version 1.0."""
    lines, size, notes = _lens_lines(camera, 1)
    return _text(camera, lines, size), (*notes, SECTIONS)


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the camera section of a stereo pair; the cameras must have one type and one size."""
    (first, second), second_from_first = pair_of(rig)
    parts = [_lens_lines(camera, i) for i, camera in enumerate((first, second), 1)]
    if first.size != second.size or _type(first) != _type(second):
        raise ValueError("both cameras must have the same Camera.type and size: convert them to the same --model")
    lines = [*parts[0][0], *parts[1][0], "", f"{STEREO}: !!opencv-matrix", "  rows: 4", "  cols: 4", "  dt: f"]
    rows = rows_of_pose(second_from_first.inverse())
    lines += [f"  data: {flow([value for row in rows for value in row])}"]
    notes = rig_notes(rig, {name: part[2] for name, part in zip(rig.names, parts, strict=True)})
    return _text(first, lines, first.size), (*notes, SECTIONS)


def _type(camera: Camera) -> str:
    return LENSES.get(camera.model.name, ("", ()))[0]


def _lens_lines(camera: Camera, number: int) -> tuple[list[str], tuple[int, int], tuple[str, ...]]:
    """Return the lines of the parameters of a camera, its image size and what they do not hold."""
    _, own = LENSES.get(camera.model.name, ("", ()))
    exported = export(camera, MODELS, [*PLANE, *own])
    # The coefficients come first: a truncated file must not read as a pinhole.
    lines = [f"Camera{number}.{name}: {flow(exported.values[name])}" for name in (*own, *PLANE)]
    return lines, exported.size, exported.result("")[1]


def _text(camera: Camera, lines: list[str], size: tuple[int, int]) -> str:
    """Return the text of a file."""
    head = ["%YAML:1.0", "", 'File.version: "1.0"', "", f'Camera.type: "{_type(camera)}"', ""]
    return "\n".join([*head, *lines, "", f"Camera.width: {size[0]}", f"Camera.height: {size[1]}"]) + "\n"


def _model(data: Mapping[str, Any], prefix: str, kind: str, used: set[str]) -> CameraModel:
    """Return the model of the keys with a prefix, and add these keys to `used`."""
    own = TYPES[kind]
    given = {name: data[f"{prefix}.{name}"] for name in (*PLANE, *own) if data.get(f"{prefix}.{name}") is not None}
    used |= {f"{prefix}.{name}" for name in given}
    needed = (*PLANE, *(own if own == FISHEYE else ()))
    if missing := [f"{prefix}.{name}" for name in needed if name not in given]:
        raise ValueError(f"{', '.join(missing)} missing")
    if own == FISHEYE:
        return build("kannala_brandt", given)
    if any(name in given for name in own):
        return build_with_zeros("radial_tangential", given)
    return build_with_zeros("pinhole", given)
