"""Kalibr's camchain yaml, and EuRoC's sensor.yaml, which has the same fields."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, kept_fields, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._values import build_with_zeros, image_size, number, numbers, rotation_matrix
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
KEPT = ("rostopic", "T_cam_imu", "timeshift_cam_imu", "line_delay")
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
        raise ValueError("holds one camera, which is no rig")
    poses = [Pose()]
    names = list(cameras)
    for previous, name in pairwise(names):
        fields, before = cameras[name].extra, cameras[previous].extra
        if "T_cn_cnm1" in fields:
            step = _pose(fields["T_cn_cnm1"], f"{name}: T_cn_cnm1")
        elif "T_cam_imu" in fields and "T_cam_imu" in before:
            imu_from_previous = _pose(before["T_cam_imu"], f"{previous}: T_cam_imu").inverse()
            step = _pose(fields["T_cam_imu"], f"{name}: T_cam_imu") @ imu_from_previous
        else:
            raise ValueError(f"{name}: neither T_cn_cnm1 nor T_cam_imu: its pose is unknown")
        poses.append(step @ poses[-1])
    return Rig(tuple(cameras.values()), tuple(poses), tuple(names))


def _pose(rows: Any, name: str) -> Pose:
    """Return the pose of a matrix (4, 4), given as 4 rows or as 16 numbers."""
    if isinstance(rows, list) and len(rows) == 16:
        rows = [rows[i : i + 4] for i in range(0, 16, 4)]
    if not isinstance(rows, list) or len(rows) != 4:
        raise ValueError(f"{name} must have 4 rows of 4 numbers")
    matrix = np.array([numbers(row, name, 4) for row in rows])
    return Pose(rotation_matrix(matrix[:3, :3].tolist(), name), matrix[:3, 3])


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a chain of one camera."""
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
        **kept_fields(camera, KEPT),
    }
    body = "".join(f"  {key}: {value if isinstance(value, str) else flow(value)}\n" for key, value in fields.items())
    text, notes = exported.result(f"cam0:\n{body}", KEPT)
    if kind[0] == "omni" and values["xi"] < 0:
        notes += ("Kalibr itself refuses an omni camera with xi < 0; its ds and eucm models hold such a lens",)
    return text, notes


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
