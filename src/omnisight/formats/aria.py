"""Project Aria's factory calibration of glasses, as projectaria_tools gives it: FISHEYE624 cameras on a device.

`params` are one focal length, the principal point, k0 ... k5, p0, p1 and s0 ... s3; `device_from_camera` is a matrix
(4, 4) in metres. As in projectaria_tools, the centre of the top-left pixel is (0, 0). `valid_radius_px` limits the
image and is kept, as are the times of `frames`.
"""

import json
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import check_supported, dropped_fields, export, unknown_fields, with_mean_focal
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import cameras_of, check_count, make_rig, pose_of_rows, rig_notes, rows_of_pose, single
from omnisight.formats._values import build, image_size, mapping, numbers
from omnisight.formats._yaml import read_map
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "Project Aria rig.json"
SUFFIX = ".json"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; device_from_camera, metres"
MODELS = ("fisheye624",)
PARAMS: tuple[str, ...] = ("f", "cx", "cy", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
KIND = "FISHEYE624"
DESCRIPTION = "FISHEYE624: fx=fy, cx, cy, k0..k5, p0, p1, s0..s3"
KNOWN = {"size", "params", "model", "device_from_camera"}
KEPT = ("valid_radius_px", "frames")
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with a `device_from_camera`."""
    return is_json_with(text, "device_from_camera")


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    return {name: camera for name, (camera, _) in cameras_of(parse_rig(text)).items()}


def parse_rig(text: str) -> Rig:
    """Return the rig of a file in the frame of the device."""
    data = read_map(text)
    entries, frames = mapping(data.get("cameras"), "cameras"), data.get("frames") or {}
    check_count(len(entries))
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, entry in entries.items():
        try:
            own = {"frames": frames[name]} if isinstance(frames, dict) and name in frames else {}
            sensors[name] = _camera(mapping(entry, "the camera"), own), _pose(entry)
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return make_rig(sensors)


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig of one camera."""
    return serialize_rig(single(camera))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig."""
    notes: dict[str, tuple[str, ...]] = {}
    cameras: dict[str, Any] = {}
    for name, (camera, pose) in cameras_of(rig).items():
        check_supported(camera, MODELS)
        single_focal, changed = with_mean_focal(camera)
        exported = export(single_focal, MODELS)
        values = {**exported.values, "f": exported.values["fx"]}
        cameras[name] = {
            "size": list(exported.size),
            "params": [values[key] for key in PARAMS],
            "model": KIND,
            "device_from_camera": rows_of_pose(pose.inverse()),
            **({"valid_radius_px": camera.extra["valid_radius_px"]} if "valid_radius_px" in camera.extra else {}),
        }
        notes[name] = changed + exported.notes + dropped_fields(camera, KEPT)
    frames = {name: c.extra["frames"] for name, c in zip(rig.names, rig.cameras, strict=True) if "frames" in c.extra}
    content = {"model": DESCRIPTION, "cameras": cameras, **({"frames": frames} if frames else {})}
    return json.dumps(content, indent=1) + "\n", rig_notes(rig, notes)


def _camera(entry: Mapping[str, Any], extra: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    if (kind := entry.get("model", KIND)) != KIND:
        raise ValueError(f"unknown model {kind!r:.40}; known is {KIND}")
    values = dict(zip(PARAMS, numbers(entry.get("params"), "params", len(PARAMS)), strict=True))
    values["fx"] = values["fy"] = values.pop("f")
    size = image_size(*numbers(entry.get("size"), "size", 2))
    return Camera(build("fisheye624", values), size, extra={**unknown_fields(entry, KNOWN), **extra})


def _pose(entry: Mapping[str, Any]) -> Pose:
    """Return sensor_from_rig of an entry."""
    return pose_of_rows(entry.get("device_from_camera"), "device_from_camera").inverse()
