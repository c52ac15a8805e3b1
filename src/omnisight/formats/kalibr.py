"""Kalibr's camchain yaml, and EuRoC's sensor.yaml, which has the same fields."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, kept_fields, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import (
    TIME_OFFSETS,
    TIME_SHIFT,
    cameras_of,
    check_count,
    imu_poses,
    in_first_frame,
    is_inverted,
    make_rig,
    pose_of_rows,
    rig_notes,
    rows_of_pose,
    shared_time_offsets,
)
from omnisight.formats._values import build_with_zeros, image_size, number, numbers
from omnisight.formats._yaml import flow, read_map
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "Kalibr camchain yaml"
SUFFIX = ".yaml"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; xi, alpha, beta precede the focal lengths"

# Kalibr's camera and distortion model: our model, our names of `intrinsics` and of `distortion_coeffs`. Others are 0.
PLANE = "fx fy cx cy"
LENSES = {
    ("pinhole", "equidistant"): ("kannala_brandt", PLANE, "k1 k2 k3 k4"),
    ("omni", "radtan"): ("mei", f"xi {PLANE}", "k1 k2 p1 p2"),
    ("omni", "none"): ("unified", f"xi {PLANE}", ""),
    ("ds", "none"): ("double_sphere", f"xi alpha {PLANE}", ""),
    ("eucm", "none"): ("eucm", f"alpha beta {PLANE}", ""),
    ("pinhole", "radtan"): ("radial_tangential", PLANE, "k1 k2 p1 p2"),
    ("pinhole", "none"): ("pinhole", PLANE, ""),
    ("pinhole", "fov"): ("fov", PLANE, "omega"),
}
MODELS = tuple(model for model, _, _ in LENSES.values())
EUROC = {"radial-tangential": "radtan"}
KNOWN = {"camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "distortion_coefficients", "resolution"}
# What a chain of one camera keeps; T_cn_cnm1 refers to the preceding camera.
KEPT = ("rostopic", "T_cam_imu", TIME_SHIFT, "line_delay")
# What a chain of several cameras holds.
CHAIN_KEPT = (*KEPT, "T_cn_cnm1", "cam_overlaps")
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether lines begin with `camera_model:` and `intrinsics:`."""
    return has_lines(text, "camera_model", "intrinsics", indented=True)


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera of the chain."""
    data = read_map(text)
    if "camera_model" in data:
        return {"cam0": _camera(data)}
    named = {key: value for key, value in data.items() if isinstance(value, dict) and "camera_model" in value}
    shared = unknown_fields(data, named)
    cameras: dict[str, Camera] = {}
    for key, value in named.items():
        try:
            cameras[key] = _camera({**shared, **value})
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from error
    return cameras


def parse_rig(text: str) -> Rig:
    """Return the rig of a chain; its frame is that of the first camera.

    The pose of a camera relative to the preceding one is `T_cn_cnm1`, or follows from `T_cam_imu` of both.
    """
    cameras = parse(text)
    if len(cameras) < 2:
        raise ValueError(
            "holds one camera, which is no rig: join the files of all cameras (omnisight convert FILES --to native)"
        )
    check_count(len(cameras))
    poses = [Pose()]
    for previous, name in pairwise(cameras):
        poses.append(_step(name, cameras[name].extra, previous, cameras[previous].extra) @ poses[-1])
    offsets = shared_time_offsets(cameras.values())
    sensors = {name: (camera, pose) for (name, camera), pose in zip(cameras.items(), poses, strict=True)}
    return replace(make_rig(sensors, offsets), provenance={"poses": "chain"})


def _step(name: str, fields: Mapping[str, Any], previous: str, before: Mapping[str, Any]) -> Pose:
    """Return the pose of a camera relative to the preceding one; raise ValueError if the file contradicts itself."""
    given = pose_of_rows(fields["T_cn_cnm1"], f"{name}: T_cn_cnm1") if "T_cn_cnm1" in fields else None
    if "T_cam_imu" not in fields or "T_cam_imu" not in before:
        if given is None:
            raise ValueError(f"{name}: neither T_cn_cnm1 nor T_cam_imu: its pose is unknown")
        return given
    now = pose_of_rows(fields["T_cam_imu"], f"{name}: T_cam_imu")
    then = pose_of_rows(before["T_cam_imu"], f"{previous}: T_cam_imu")
    if given is None:
        return now @ then.inverse()
    if is_inverted(given, now @ then.inverse()):
        raise ValueError(
            f"the extrinsics of {name} are inverted: T_cn_cnm1 maps points of {name} to {previous}, as T_cam_imu of"
            f" both shows, and must map points of {previous} to {name}: use its inverse, or remove the line"
        )
    if is_inverted(given.inverse(), now.inverse() @ then):
        raise ValueError(
            f"the extrinsics of {previous} and {name} are inverted: T_cam_imu maps points of the cameras to the IMU, as"
            f" T_cn_cnm1 of {name} shows, and must map points of the IMU to the cameras: use the inverse of each"
            " T_cam_imu"
        )
    return given


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a chain of one camera."""
    fields, notes = _fields(camera, KEPT)
    return _block("cam0", fields | kept_fields(camera, KEPT)), notes


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a chain, with `T_cam_imu` if the pose of the IMU is known; the cameras are numbered."""
    cam_from_imu, (posed, frame_note) = imu_poses(rig), in_first_frame(rig)
    text, notes = "", dict[str, tuple[str, ...]]()
    before = Pose()
    for i, (name, (camera, pose)) in enumerate(cameras_of(posed).items()):
        fields, notes[name] = _fields(camera, CHAIN_KEPT)
        fields |= kept_fields(camera, ("rostopic", TIME_SHIFT, "line_delay", "cam_overlaps"))
        if i:
            fields["T_cn_cnm1"] = rows_of_pose(pose @ before.inverse())
        if cam_from_imu is not None:
            fields["T_cam_imu"] = rows_of_pose(cam_from_imu[i])
        if rig.time_offsets:
            fields[TIME_SHIFT] = rig.time_offsets[i]
        text, before = text + _block(f"cam{i}", fields), pose
    return text, frame_note + rig_notes(rig, notes, (TIME_OFFSETS,))


def _block(name: str, fields: Mapping[str, Any]) -> str:
    """Return the lines of a camera."""
    lines = (f"  {key}: {value if isinstance(value, str) else flow(value)}\n" for key, value in fields.items())
    return f"{name}:\n{''.join(lines)}"


def _fields(camera: Camera, kept: tuple[str, ...]) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the fields of a camera without poses, and what a file with them and `kept` does not hold."""
    kind = next((kind for kind, lens in LENSES.items() if lens[0] == camera.model.name), ("pinhole", "none"))
    _, intrinsics, coefficients = LENSES[kind]
    exported = export(camera, MODELS, [*intrinsics.split(), *coefficients.split()])
    values = exported.values
    fields: dict[str, Any] = {
        "camera_model": kind[0],
        "intrinsics": [values[name] for name in intrinsics.split()],  # Kalibr refuses an integer here ...
        "distortion_model": kind[1],
        "distortion_coeffs": [values[name] for name in coefficients.split()],
        "resolution": list(exported.size),  # ... and anything else here
    }
    _, notes = exported.result("", kept)
    if kind[0] == "omni" and values["xi"] < 0:
        notes += ("Kalibr itself refuses an omni camera with xi < 0; its ds and eucm models hold such a lens",)
    return fields, notes


def _camera(fields: Mapping[str, Any]) -> Camera:
    # A truncated file must not silently lose its distortion.
    if missing := [key for key in ("intrinsics", "distortion_model", "resolution") if fields.get(key) is None]:
        raise ValueError(f"{', '.join(missing)} missing (distortion_model: none if there is none)")
    distortion = str(fields["distortion_model"])
    kind = str(fields["camera_model"]), EUROC.get(distortion, distortion)
    if kind not in LENSES:
        known = ", ".join("-".join(k) for k in LENSES)
        raise ValueError(f"unknown camera model {kind[0][:30]!r} with distortion {kind[1][:30]!r}; known are {known}")
    model, intrinsics, coefficients = LENSES[kind]
    names = intrinsics.split()
    given = dict(zip(names, numbers(fields["intrinsics"], f"{kind[0]} intrinsics", len(names)), strict=True))
    names = coefficients.split()
    values = fields.get("distortion_coeffs", fields.get("distortion_coefficients")) or []
    if kind[1] == "none" and isinstance(values, list) and not any(number(v, "distortion_coeffs") for v in values):
        values = []
    given |= dict(zip(names, numbers(values, f"{kind[1]} distortion_coeffs", len(names)), strict=True))
    size = image_size(*numbers(fields["resolution"], "resolution", 2))
    return Camera(build_with_zeros(model, given), size, extra=unknown_fields(fields, KNOWN))
