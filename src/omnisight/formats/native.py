"""omnisight's own JSON: a central camera, a non-central camera, or a rig."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._export import unknown_fields
from omnisight.formats._limits import HEAD_CHARS, MAX_DISTINCT_CAMERAS, MAX_NAME_CHARS, MAX_PARAMETERS
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import time_offset_notes
from omnisight.formats._values import (
    MAX_SIDE_PX,
    MAX_VALUE,
    build_mirrored,
    check_bounds,
    check_model,
    number,
    numbers,
    rotation_matrix,
)
from omnisight.geometry.pose import Pose
from omnisight.models import CameraModel, model_names
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.models import RayModel, ray_model_class
from omnisight.ray_camera import UNITS, RayCamera
from omnisight.rig import Rig

TITLE = "omnisight JSON"
SUFFIX = ".json"
MODELS = model_names()
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0); size is [width, height]"
VERSION = 1
KEYS = {
    *("format", "version", "model", "params", "units", "size", "convention", "theta_max_deg", "theta_min_deg"),
    *("calibration", "covariance", "provenance", "rms_definition"),
}
RMS_DEFINITION = "root mean square of the residual length |d|, px, over all corners"
RIG_UNITS = (*UNITS, "units")
CAMERA, RAY_CAMERA, RIG = "omnisight-camera", "omnisight-ray-camera", "omnisight-rig"
TITLES = {CAMERA: "a camera", RAY_CAMERA: "a camera", RIG: "a rig of cameras"}
MAX_COVARIANCE = MAX_VALUE**2  # of two parameters of the largest size
MAX_OPTICAL_PARTS = 9  # a lens and its mirrors
COMMENT = ""
READERS = dict.fromkeys(MODELS, Reader("omnisight"))


def matches(text: str) -> bool:
    """Return whether this is omnisight's JSON."""
    return text.lstrip().startswith("{") and '"omnisight' in text[:HEAD_CHARS]


def parse(text: str) -> Mapping[str, Camera | RayCamera]:
    """Return the camera, or the cameras of a rig by name."""
    data: Any = json.loads(text)
    if data.get("format") == RIG:
        rig = rig_from_json(data)
        return dict(zip(rig.names, rig.cameras, strict=True))
    return {"camera": camera_from_json(data)}


def camera_from_json(data: Any) -> Camera | RayCamera:
    """Return a camera from the object that a file holds."""
    kind = _check_header(data, (CAMERA, RAY_CAMERA))
    if missing := sorted({"model", "params", "size"} - set(data)):
        raise ValueError(f"missing {', '.join(missing)}")
    size = data["size"]
    if not (isinstance(size, list) and len(size) == 2 and all(type(s) is int and 0 <= s <= MAX_SIDE_PX for s in size)):
        raise ValueError(f'"size" must be [width, height], got {size!r:.60}')
    for name in ("params", "calibration", "provenance"):
        if not isinstance(data.get(name) or {}, dict):
            raise ValueError(f'"{name}" must be an object, got {data[name]!r:.60}')
    params, name = data["params"] or {}, data["model"]
    if not isinstance(name, str) or len(name) > MAX_NAME_CHARS:
        raise ValueError(f'"model" must be the name of a model, got {name!r:.60}')
    if len(params) > MAX_PARAMETERS:
        raise ValueError(f"{len(params)} parameters; a camera has at most {MAX_PARAMETERS}")
    theta_max, theta_min = _calibrated_angles(data)
    common: dict[str, Any] = {
        "size": (size[0], size[1]),
        "theta_max": theta_max,
        "theta_min": theta_min,
        "calibration": data.get("calibration") or {},
        "provenance": data.get("provenance") or {},
    }
    if kind == CAMERA:
        model = build_mirrored(name, params)
        covariance = _covariance(data, len(model.params))
        return Camera(model, covariance=covariance, extra=unknown_fields(data, KEYS), **common)
    rays = _ray_model(name, params)
    if (unit := data.get("length_unit", "m")) not in UNITS:
        raise ValueError(f"length_unit must be {' or '.join(UNITS)}, got {unit!r:.60}")
    extra = unknown_fields(data, KEYS | {"length_unit"})
    covariance = _covariance(data, len(rays.params))
    return RayCamera(rays, unit=unit, covariance=covariance, extra=extra, **common)


def _ray_model(name: str, params: dict[str, Any]) -> RayModel:
    """Return the non-central model of these parameters; those that are texts name lenses and mirrors."""
    values = {k: v[:MAX_NAME_CHARS] if isinstance(v, str) else number(v, k) for k, v in params.items()}
    if (parts := sum(isinstance(value, str) for value in values.values())) > MAX_OPTICAL_PARTS:
        raise ValueError(f"{parts} lenses and mirrors; a camera has at most {MAX_OPTICAL_PARTS}")
    model = (Catadioptric if name == Catadioptric.name else ray_model_class(name)).from_dict(values)
    check_bounds(model)
    for part in vars(model).values():
        if isinstance(part, CameraModel):  # its lens
            check_model(part)
    return model


def parse_rig(text: str) -> Rig:
    """Return the rig of a file."""
    return rig_from_json(json.loads(text))


def rig_from_json(data: Any) -> Rig:
    """Return a rig from the object that a file holds."""
    _check_header(data, (RIG,))
    sensors = data.get("sensors")
    if not isinstance(sensors, dict) or not all(isinstance(value, dict) for value in sensors.values()):
        raise ValueError('"sensors" must be an object of cameras by name')
    if len(sensors) > MAX_DISTINCT_CAMERAS:
        raise ValueError(f"{len(sensors)} cameras; a rig has at most {MAX_DISTINCT_CAMERAS}")
    cameras: dict[str, tuple[Camera | RayCamera, Pose]] = {}
    for name, sensor in sensors.items():
        if not name.isprintable() or not 0 < len(name) <= MAX_NAME_CHARS:
            raise ValueError(
                f"the name of a camera must be 1 to {MAX_NAME_CHARS} printable characters, got"
                f" {name[:MAX_NAME_CHARS]!r}"
            )
        try:
            cameras[name] = camera_from_json(sensor["camera"]), _pose(sensor["sensor_from_rig"])
        except KeyError as error:
            raise ValueError(f"sensor {name}: missing {error.args[0]}") from None
        except ValueError as error:
            raise ValueError(f"sensor {name}: {error}") from None
    offsets = [number(sensor.get("time_offset_s", 0.0), "time_offset_s") for sensor in sensors.values()]
    unit = data.get("length_unit", "m")
    if unit not in RIG_UNITS:
        raise ValueError(f"length_unit must be one of {', '.join(RIG_UNITS)}, got {unit!r:.60}")
    for name in ("calibration", "provenance"):
        if not isinstance(data.get(name) or {}, dict):
            raise ValueError(f"{name} must be an object, got {data[name]!r:.60}")
    return replace(
        Rig.from_sensors(cameras),
        covariance=_covariance(data, 6 * len(cameras)),
        time_offsets=tuple(offsets) if any(offsets) else (),
        unit=unit,
        calibration=data.get("calibration") or {},
        provenance=data.get("provenance") or {},
    )


def _pose(data: Any) -> Pose:
    """Return a pose from its object."""
    if not isinstance(data, dict):
        raise ValueError(f"sensor_from_rig must be an object with rotation and translation, got {data!r:.60}")
    rotation = rotation_matrix(data["rotation"], "rotation")
    return Pose(rotation, np.array(numbers(data["translation"], "translation", 3)))


def _check_header(data: Any, kinds: tuple[str, ...]) -> str:
    """Return the kind of an object, or raise ValueError for a wrong header."""
    if not isinstance(data, dict) or data.get("format") not in kinds:
        actual = data.get("format") if isinstance(data, dict) else data
        if actual in TITLES:
            raise ValueError(f"is {TITLES[actual]}, not {TITLES[kinds[0]]}")
        raise ValueError(f'"format" is {actual!r:.60}, not "{kinds[0]}"')
    if not isinstance(data.get("version"), int) or data["version"] > VERSION:
        raise ValueError(
            f"version {data.get('version')!r:.60}; this version of omnisight reads up to {VERSION}: update it"
        )
    if data["version"] is True or data["version"] < 1:
        raise ValueError(f"invalid version {data['version']!r}")
    return data["format"]


def _calibrated_angles(data: dict[str, Any]) -> tuple[float | None, float]:
    """Return the largest and the smallest calibrated angle from the axis (radians)."""
    high, low = data.get("theta_max_deg"), number(data.get("theta_min_deg") or 0.0, "theta_min_deg")
    if high is not None and not 0 < number(high, "theta_max_deg") <= 180:
        raise ValueError(f"theta_max_deg must lie between 0 and 180, got {high:g}")
    if not 0 <= low < (180 if high is None else high):
        raise ValueError(f"theta_min_deg must lie between 0 and theta_max_deg, got {low:g}")
    return None if high is None else float(np.radians(high)), float(np.radians(low))


def _covariance(data: dict[str, Any], count: int) -> NDArray[np.float64] | None:
    """Return the covariance of the parameters, or None if the file has none."""
    if (rows := data.get("covariance")) is None:
        return None
    if not isinstance(rows, list) or len(rows) != count:
        raise ValueError(f"covariance must have {count} rows of {count} numbers")
    matrix = np.array([numbers(row, "covariance", count, MAX_COVARIANCE) for row in rows])
    if (np.diagonal(matrix) < 0).any():
        raise ValueError("covariance has a negative variance")
    return matrix


def _covariance_rows(covariance: NDArray[np.float64] | None) -> list[list[float]] | None:
    """Return the rows of a covariance; None if it is not finite or too large to be read, which means unknown."""
    if covariance is None or not (np.abs(covariance) <= MAX_COVARIANCE).all():
        return None
    return covariance.tolist()


def to_json(camera: Camera | RayCamera) -> dict[str, Any]:
    """Return the camera as the object that the file holds."""
    non_central = isinstance(camera, RayCamera)
    length = camera.unit if non_central else "m"
    return {
        "format": RAY_CAMERA if non_central else CAMERA,
        "version": VERSION,
        "model": camera.model.name,
        "params": camera.model.to_dict(),
        "units": {p.name: length if p.unit == "m" else p.unit or "1" for p in camera.model.parameters},
        **({"length_unit": length} if non_central else {}),
        "size": list(camera.size),
        "convention": CONVENTION,
        "theta_max_deg": None if camera.theta_max is None else float(np.degrees(camera.theta_max)),
        "theta_min_deg": float(np.degrees(camera.theta_min)),
        "calibration": dict(camera.calibration),
        "rms_definition": RMS_DEFINITION,
        "covariance": _covariance_rows(camera.covariance),
        "provenance": dict(camera.provenance),
        # A key of another tool that equals one of ours is renamed.
        **{(f"extra_{key}" if key in KEYS else key): value for key, value in camera.extra.items()},
    }


def rig_to_json(rig: Rig) -> dict[str, Any]:
    """Return the rig as the object that the file holds."""
    sensors = {
        name: {
            "sensor_from_rig": {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()},
            **({"time_offset_s": rig.time_offsets[k]} if rig.time_offsets else {}),
            "camera": to_json(camera),
        }
        for k, (name, camera, pose) in enumerate(zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True))
    }
    return {
        "format": RIG,
        "version": VERSION,
        "convention": "x_sensor = sensor_from_rig x_rig",
        "length_unit": rig.unit,
        "sensors": sensors,
        "calibration": dict(rig.calibration),
        "covariance": _covariance_rows(rig.covariance),
        "provenance": dict(rig.provenance),
    }


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig; nothing is lost."""
    return json.dumps(rig_to_json(rig), indent=2, allow_nan=False) + "\n", time_offset_notes(rig)


def serialize(camera: Camera | RayCamera) -> tuple[str, tuple[str, ...]]:
    """Return the text; nothing is lost."""
    return json.dumps(to_json(camera), indent=2, allow_nan=False) + "\n", ()
