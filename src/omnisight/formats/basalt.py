"""Basalt's calibration.json."""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, numbers, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map

TITLE = "Basalt calibration.json"
SUFFIX = ".json"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; T_imu_cam takes the camera's frame to the IMU's"
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
KIND = re.compile(r'"camera_type"\s*:')


def matches(text: str) -> bool:
    """Say whether this is JSON with a `camera_type` and no file of our own."""
    return text.lstrip().startswith("{") and '"omnisight' not in text[:2000] and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    data = read_map(text)
    inner = data.get("value0", data)
    if not isinstance(inner, dict) or not isinstance(inner.get("intrinsics"), list):
        raise ValueError("value0.intrinsics must be a list of cameras")
    lenses, sizes, poses = inner["intrinsics"], inner.get("resolution"), inner.get("T_imu_cam")
    if sizes is not None and (not isinstance(sizes, list) or len(sizes) != len(lenses)):
        raise ValueError(
            f"resolution must have one [width, height] for each of {len(lenses)} cameras, got {sizes!r:.60}"
        )
    beside = note_unknown(inner, {"intrinsics", "resolution", "T_imu_cam"})
    cameras: dict[str, Camera] = {}
    for i, lens in enumerate(lenses):
        size = picture_size(*numbers(sizes[i], f"resolution[{i}]", 2)) if sizes else (0, 0)
        extra = dict(beside)
        if isinstance(poses, list) and i < len(poses):
            extra["T_imu_cam"] = poses[i]
        cameras[f"cam{i}"] = Camera(_model(lens, f"cam{i}"), size, extra=extra)
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of one camera, at the IMU unless its file said where."""
    refuse(camera, MODELS)
    size = with_size(camera)
    camera, notes = without(camera, [n for n in camera.model.param_names if n != "skew"])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    kind = next(kind for kind, (model, _) in LENSES.items() if model == camera.model.name)
    if kind == "ucm":
        # alpha = xi/(1 + xi) and the focal length (1 - alpha) gamma.
        if values["xi"] < 0:
            notes += ("Basalt wants alpha in [0, 1), and that of a camera with xi < 0 is negative",)
        alpha = values["xi"] / (1 + values["xi"])
        values |= {"alpha": alpha, "fx": values["fx"] * (1 - alpha), "fy": values["fy"] * (1 - alpha)}
    if kind == "fov":
        values["w"] = values["omega"]
    names = (*PLANE, *LENSES[kind][1].split())
    at_imu = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    content: dict[str, Any] = {
        "T_imu_cam": [camera.extra.get("T_imu_cam", at_imu)],
        "intrinsics": [{"camera_type": kind, "intrinsics": {name: values[name] for name in names}}],
        "resolution": [list(size)],
    }
    notes += ("Basalt's odometry also needs the IMU's fields, which are not written",)
    return json.dumps({"value0": content}, indent=2) + "\n", notes + left_out(camera, ("T_imu_cam",))


def _model(lens: Any, name: str) -> Any:
    kind = lens.get("camera_type") if isinstance(lens, dict) else None
    if kind not in LENSES:
        raise ValueError(f"{name}: no camera_type {kind!r:.40}; there are {', '.join(LENSES)}")
    model, own = LENSES[kind]
    given = lens.get("intrinsics")
    names = (*PLANE, *own.split())
    if not isinstance(given, dict) or set(given) != set(names):
        found = ", ".join(given) if isinstance(given, dict) else repr(given)[:40]
        raise ValueError(f"{name}: {kind} has {', '.join(names)}, got {found}")
    values = {key: number(value, f"{name} {key}") for key, value in given.items()}
    if kind == "fov":
        values["omega"] = values.pop("w")
    if kind == "ucm":
        alpha = values.pop("alpha")
        if not alpha < 1:
            raise ValueError(f"{name}: alpha of ucm must be below 1, got {alpha:g}")
        values |= {"xi": alpha / (1 - alpha), "fx": values["fx"] / (1 - alpha), "fy": values["fy"] / (1 - alpha)}
    return build(model, values)
