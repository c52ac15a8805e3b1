"""Basalt's calibration.json."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import export, known_size, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import (
    IMU,
    cameras_of,
    check_count,
    imu_poses,
    make_rig,
    pose_of_quaternion,
    rig_notes,
)
from omnisight.formats._values import (
    alpha_from_unified,
    build,
    image_size,
    mapping,
    number,
    numbers,
    unified_from_alpha,
)
from omnisight.formats._yaml import read_map
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import quaternions
from omnisight.models import CameraModel
from omnisight.rig import Rig

TITLE = "Basalt calibration.json"
SUFFIX = ".json"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; T_imu_cam is imu_from_cam"
LENSES = {
    "kb4": ("kannala_brandt", "k1 k2 k3 k4"),
    "ds": ("double_sphere", "xi alpha"),
    "eucm": ("eucm", "alpha beta"),
    "ucm": ("unified", "alpha"),
    "fov": ("fov", "w"),
    "pinhole": ("pinhole", ""),
}
MODELS = tuple(model for model, _ in LENSES.values())
PLANE = ("fx", "fy", "cx", "cy")
AT_IMU = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
NO_IMU = "Basalt's odometry also needs the fields of the IMU, which are not written"
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with a `camera_type`."""
    return is_json_with(text, "camera_type")


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    data = read_map(text)
    inner = mapping(data.get("value0", data), "value0")
    if not isinstance(inner.get("intrinsics"), list):
        raise ValueError("value0.intrinsics must be a list of cameras")
    lenses, sizes, poses = inner["intrinsics"], inner.get("resolution"), inner.get("T_imu_cam")
    if sizes is not None and (not isinstance(sizes, list) or len(sizes) != len(lenses)):
        raise ValueError(
            f"resolution must have one [width, height] for each of {len(lenses)} cameras, got {sizes!r:.60}"
        )
    shared = unknown_fields(inner, {"intrinsics", "resolution", "T_imu_cam"})
    cameras: dict[str, Camera] = {}
    for i, lens in enumerate(lenses):
        size = image_size(*numbers(sizes[i], f"resolution[{i}]", 2)) if sizes else (0, 0)
        extra = dict(shared)
        if isinstance(poses, list) and i < len(poses):
            extra["T_imu_cam"] = poses[i]
        cameras[f"cam{i}"] = Camera(_model(lens, f"cam{i}"), size, extra=extra)
    return cameras


def parse_rig(text: str) -> Rig:
    """Return the rig of a file in the frame of the IMU."""
    cameras = parse(text)
    check_count(len(cameras))
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, camera in cameras.items():
        if "T_imu_cam" not in camera.extra:
            raise ValueError(f"{name}: no pose in T_imu_cam")
        sensors[name] = camera, _pose(camera.extra["T_imu_cam"], f"{name}: T_imu_cam").inverse()
    return replace(make_rig(sensors), provenance={"rig_frame": IMU})


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of one camera, at the IMU unless its file held a pose."""
    lens, notes = _lens(camera)
    size = list(known_size(camera))
    content = {"T_imu_cam": [camera.extra.get("T_imu_cam", AT_IMU)], "intrinsics": [lens], "resolution": [size]}
    return json.dumps({"value0": content}, indent=2) + "\n", (NO_IMU, *notes)


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig; without a known IMU, the rig frame takes its place. The cameras are numbered."""
    poses, notes = imu_poses(rig), dict[str, tuple[str, ...]]()
    frame_note = () if poses is not None else ("the pose of the IMU is not known: T_imu_cam is rig_from_cam",)
    lenses: list[dict[str, Any]] = []
    for name, (camera, _) in cameras_of(rig).items():
        lens, notes[name] = _lens(camera)
        lenses.append(lens)
    content: dict[str, Any] = {
        "T_imu_cam": [_seven(pose.inverse()) for pose in poses or rig.sensor_from_rig],
        "intrinsics": lenses,
        "resolution": [list(camera.size) for camera in rig.cameras],
    }
    return json.dumps({"value0": content}, indent=2) + "\n", (NO_IMU, *frame_note, *rig_notes(rig, notes))


def _lens(camera: Camera) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the entry of `intrinsics` of a camera and what it does not hold."""
    exported = export(camera, MODELS)
    values = exported.values
    kind = next(kind for kind, (model, _) in LENSES.items() if model == camera.model.name)
    notes: tuple[str, ...] = ()
    if kind == "ucm":
        if values["xi"] < 0:
            notes = ("Basalt requires alpha in [0, 1), and alpha of a camera with xi < 0 is negative",)
        values = alpha_from_unified(values)
    if kind == "fov":
        values["w"] = values["omega"]
    names = (*PLANE, *LENSES[kind][1].split())
    entry = {"camera_type": kind, "intrinsics": {name: values[name] for name in names}}
    return entry, notes + exported.result("", ("T_imu_cam",))[1]


def _pose(entry: Any, name: str) -> Pose:
    """Return the pose of an entry of `T_imu_cam`."""
    values = [number(mapping(entry, name).get(key), f"{name} {key}") for key in AT_IMU]
    return pose_of_quaternion(values[3:], values[:3], name)


def _seven(pose: Pose) -> dict[str, float]:
    """Return the entry of `T_imu_cam` of a pose."""
    return dict(zip(AT_IMU, (*pose.translation.tolist(), *quaternions(pose.rotation).tolist()), strict=True))


def _model(lens: Any, name: str) -> CameraModel:
    """Return the model of an entry of `intrinsics`."""
    kind = lens.get("camera_type") if isinstance(lens, dict) else None
    if kind not in LENSES:
        raise ValueError(f"{name}: unknown camera_type {kind!r:.40}; known are {', '.join(LENSES)}")
    model, own = LENSES[kind]
    given = lens.get("intrinsics")
    names = (*PLANE, *own.split())
    if not isinstance(given, dict) or set(given) != set(names):
        actual = ", ".join(given) if isinstance(given, dict) else repr(given)[:40]
        raise ValueError(f"{name}: {kind} has {', '.join(names)}, got {actual}")
    values = {key: number(value, f"{name} {key}") for key, value in given.items()}
    if kind == "fov":
        values["omega"] = values.pop("w")
    if kind == "ucm":
        values = unified_from_alpha(values)
    return build(model, values)
