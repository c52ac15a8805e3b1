"""Kalibr's camchain yaml, and EuRoC's sensor.yaml, which has the same fields."""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, numbers, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import flow, read_map

TITLE = "Kalibr camchain yaml"
SUFFIX = ".yaml"
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; xi, alpha, beta stand before the focal lengths"

# Kalibr's camera and distortion model: our model, our names of `intrinsics`, and of `distortion_coeffs`. The rest is 0.
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
# What a chain of one camera may say of it; T_cn_cnm1 speaks of the camera before it.
KEPT = ("rostopic", "T_cam_imu", "timeshift_cam_imu", "line_delay")
FIELDS = re.compile(r"^[ \t]*camera_model[ \t]*:", re.MULTILINE), re.compile(r"^[ \t]*intrinsics[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether lines begin with `camera_model:` and `intrinsics:`."""
    return all(field.search(text[:1_000_000]) for field in FIELDS)


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera of the chain."""
    data = read_map(text)
    if "camera_model" in data:
        return {"cam0": _camera(data)}
    named = {key: value for key, value in data.items() if isinstance(value, dict) and "camera_model" in value}
    beside = note_unknown(data, set(named))
    cameras: dict[str, Camera] = {}
    for key, value in named.items():
        try:
            cameras[key] = _camera({**beside, **value})
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from error
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of a chain of one camera."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind = next(kind for kind, lens in LENSES.items() if lens[0] == camera.model.name)
    _, intrinsics, coefficients = LENSES[kind]
    camera, notes = without(camera, [*intrinsics.split(), *coefficients.split()])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    fields: dict[str, Any] = {
        "camera_model": kind[0],
        "intrinsics": [values[name] for name in intrinsics.split()],  # Kalibr refuses an integer here ...
        "distortion_model": kind[1],
        "distortion_coeffs": [values[name] for name in coefficients.split()],
        "resolution": list(size),  # ... and anything else here
        **{key: camera.extra[key] for key in KEPT if key in camera.extra},
    }
    if kind[0] == "omni" and values["xi"] < 0:
        notes += ("Kalibr itself refuses an omni camera with xi < 0; its ds or eucm hold such a lens",)
    body = "".join(f"  {key}: {value if isinstance(value, str) else flow(value)}\n" for key, value in fields.items())
    return f"cam0:\n{body}", notes + left_out(camera, KEPT)


def _camera(fields: Mapping[str, Any]) -> Camera:
    # Without these a file is cut off: a lens must not lose its distortion in silence.
    if missing := [key for key in ("intrinsics", "distortion_model", "resolution") if fields.get(key) is None]:
        raise ValueError(f"{', '.join(missing)} missing (distortion_model: none if there is none)")
    distortion = str(fields["distortion_model"])
    kind = str(fields["camera_model"]), EUROC.get(distortion, distortion)
    if kind not in LENSES:
        known = ", ".join("-".join(k) for k in LENSES)
        raise ValueError(f"no camera model {kind[0][:30]!r} with distortion {kind[1][:30]!r}; there are {known}")
    model, intrinsics, coefficients = LENSES[kind]
    names = intrinsics.split()
    given = dict(zip(names, numbers(fields["intrinsics"], f"{kind[0]} intrinsics", len(names)), strict=True))
    names = coefficients.split()
    values = fields.get("distortion_coeffs", fields.get("distortion_coefficients")) or []
    if kind[1] == "none" and isinstance(values, list) and not any(number(v, "distortion_coeffs") for v in values):
        values = []
    given |= dict(zip(names, numbers(values, f"{kind[1]} distortion_coeffs", len(names)), strict=True))
    if model == "radial_tangential":
        given["k3"] = 0.0
    size = picture_size(*numbers(fields["resolution"], "resolution", 2))
    return Camera(build(model, given), size, extra=note_unknown(fields, KNOWN))
