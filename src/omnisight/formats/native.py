"""omnisight's own JSON: a camera, a camera of rays, or a rig of several."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._checks import build_mirrored, must_be_bounded, must_be_possible, number, numbers
from omnisight.formats._protocol import note_unknown
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import nearest
from omnisight.models import CameraModel, model_names
from omnisight.optics.catadioptric import Catadioptric
from omnisight.optics.models import ray_model_class
from omnisight.ray_camera import UNITS, RayCamera
from omnisight.rig import Rig

TITLE = "omnisight JSON"
SUFFIX = ".json"
MODELS = model_names()
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0); size is [width, height]"
VERSION = 1
_FIRST = {"format", "version", "model", "params", "units", "size", "convention", "theta_max_deg", "theta_min_deg"}
KEYS = _FIRST | {"calibration", "covariance", "provenance", "rms_definition"}
RMS = "root mean square of the residual's length |d|, px, over all corners"
CAMERA, RAYS, RIG = "omnisight-camera", "omnisight-ray-camera", "omnisight-rig"
# By how much a rotation of a file may be none.
SKEWED = 1e-6
# More than any camera, mirror system or rig has: parameters, a lens with its mirrors, cameras, letters of a name.
PARAMETERS, PARTS, SENSORS, LETTERS = 2000, 9, 200, 80


def matches(text: str) -> bool:
    """Say whether this is omnisight's JSON."""
    return text.lstrip().startswith("{") and '"omnisight' in text[:2000]


def parse(text: str) -> Mapping[str, Camera | RayCamera]:
    """Read the camera, or those of a rig by their names."""
    data: Any = json.loads(text)
    if data.get("format") == RIG:
        rig = rig_from_json(data)
        return dict(zip(rig.names, rig.cameras, strict=True))
    return {"camera": camera_from_json(data)}


def camera_from_json(data: Any) -> Camera | RayCamera:
    """Read a camera from the object that a file holds."""
    central = _checked(data, (CAMERA, RAYS)) == CAMERA
    if missing := sorted({"model", "params", "size"} - set(data)):
        raise ValueError(f"missing {', '.join(missing)}")
    size = data["size"]
    if not (isinstance(size, list) and len(size) == 2 and all(type(s) is int and 0 <= s < 10**6 for s in size)):
        raise ValueError(f'"size" must be [width, height], got {size!r:.60}')
    for name in ("params", "calibration", "provenance"):
        if not isinstance(data.get(name) or {}, dict):
            raise ValueError(f'"{name}" must be an object, got {data[name]!r:.60}')
    params, name = data["params"] or {}, data["model"]
    if not isinstance(name, str) or len(name) > LETTERS:
        raise ValueError(f'"model" must be the name of a model, got {name!r:.60}')
    if len(params) > PARAMETERS:
        raise ValueError(f"{len(params)} parameters; a camera has at most {PARAMETERS}")
    theta_max, theta_min = _cone(data)
    common: dict[str, Any] = {
        "theta_max": theta_max,
        "theta_min": theta_min,
        "calibration": data.get("calibration") or {},
        "provenance": data.get("provenance") or {},
    }
    covariance = data.get("covariance")
    if not central:
        # Names of lenses and mirrors are the things here that are no numbers.
        values = {k: v[:LETTERS] if isinstance(v, str) else number(v, k) for k, v in params.items()}
        if (parts := sum(isinstance(value, str) for value in values.values())) > PARTS:
            raise ValueError(f"{parts} lenses and mirrors; a camera has at most {PARTS}")
        kind = Catadioptric if name == Catadioptric.name else ray_model_class(name)
        rays = kind.from_dict(values)
        must_be_bounded(rays)
        for part in vars(rays).values():
            if isinstance(part, CameraModel):  # its lens
                must_be_possible(part)
        if (unit := data.get("length_unit", "m")) not in UNITS:
            raise ValueError(f"length_unit must be {' or '.join(UNITS)}, got {unit!r:.60}")
        common["covariance"] = None if covariance is None else _covariance(covariance, len(rays.params))
        extra = note_unknown(data, KEYS | {"length_unit"})
        return RayCamera(rays, (size[0], size[1]), unit, extra=extra, **common)
    model = build_mirrored(name, params)
    common["covariance"] = None if covariance is None else _covariance(covariance, len(model.params))
    return Camera(model, (size[0], size[1]), extra=note_unknown(data, KEYS), **common)


def rig_from_json(data: Any) -> Rig:
    """Read a rig from the object that a file holds."""
    _checked(data, (RIG,))
    sensors = data.get("sensors")
    if not isinstance(sensors, dict) or not all(isinstance(value, dict) for value in sensors.values()):
        raise ValueError('"sensors" must be an object of cameras by name')
    if len(sensors) > SENSORS:
        raise ValueError(f"{len(sensors)} cameras; a rig has at most {SENSORS}")
    found: dict[str, tuple[Camera | RayCamera, Pose]] = {}
    for name, sensor in sensors.items():
        if not name.isprintable() or not 0 < len(name) <= LETTERS:
            raise ValueError(f"a camera's name must be 1 to {LETTERS} printable characters, got {name[:LETTERS]!r}")
        try:
            found[name] = camera_from_json(sensor["camera"]), _pose(sensor["sensor_from_rig"])
        except KeyError as error:
            raise ValueError(f"sensor {name}: missing {error.args[0]}") from None
        except ValueError as error:
            raise ValueError(f"sensor {name}: {error}") from None
    return Rig.from_sensors(found)


def _pose(data: Any) -> Pose:
    if not isinstance(data, dict):
        raise ValueError(f"sensor_from_rig must be an object with rotation and translation, got {data!r:.60}")
    rows = data["rotation"]
    if not isinstance(rows, list) or len(rows) != 3:
        raise ValueError("rotation must have 3 rows of 3 numbers")
    rotation = np.array([numbers(row, "rotation", 3) for row in rows])
    turned = nearest(rotation)
    if np.abs(turned - rotation).max() > SKEWED:
        raise ValueError(f"rotation is none: it is {np.abs(turned - rotation).max():.2g} off the nearest one")
    return Pose(turned, np.array(numbers(data["translation"], "translation", 3)))


def _checked(data: Any, kinds: tuple[str, ...]) -> str:
    """Give the kind of object, or say what is wrong with its header."""
    if not isinstance(data, dict) or data.get("format") not in kinds:
        found = data.get("format") if isinstance(data, dict) else data
        raise ValueError(f'"format" is {found!r:.60}, not "{kinds[0]}"')
    if not isinstance(data.get("version"), int) or data["version"] > VERSION:
        raise ValueError(f"version {data.get('version')!r:.60}; this omnisight reads up to {VERSION}: update it")
    if data["version"] is True or data["version"] < 1:
        raise ValueError(f"version {data['version']!r} is none")
    return data["format"]


def _cone(data: dict[str, Any]) -> tuple[float | None, float]:
    """Give the angles from the axis (radians) between which corners were seen."""
    high, low = data.get("theta_max_deg"), number(data.get("theta_min_deg") or 0.0, "theta_min_deg")
    if high is not None and not 0 < number(high, "theta_max_deg") <= 180:
        raise ValueError(f"theta_max_deg must lie between 0 and 180, got {high:g}")
    if not 0 <= low < (180 if high is None else high):
        raise ValueError(f"theta_min_deg must lie between 0 and theta_max_deg, got {low:g}")
    return None if high is None else float(np.radians(high)), float(np.radians(low))


def _covariance(rows: Any, count: int) -> NDArray[np.float64]:
    if not isinstance(rows, list) or len(rows) != count:
        raise ValueError(f"covariance must have {count} rows of {count} numbers")
    matrix = np.array([numbers(row, "covariance", count) for row in rows])
    if (np.diagonal(matrix) < 0).any():
        raise ValueError("covariance has a negative variance")
    return matrix


def to_json(camera: Camera | RayCamera) -> dict[str, Any]:
    """Give the camera as the object that the file holds."""
    rays = isinstance(camera, RayCamera)
    length = camera.unit if rays else "m"
    return {
        "format": RAYS if rays else CAMERA,
        "version": VERSION,
        "model": camera.model.name,
        "params": camera.model.to_dict(),
        "units": {p.name: length if p.unit == "m" else p.unit or "1" for p in camera.model.parameters},
        **({"length_unit": length} if rays else {}),
        "size": list(camera.size),
        "convention": CONVENTION,
        "theta_max_deg": None if camera.theta_max is None else float(np.degrees(camera.theta_max)),
        "theta_min_deg": float(np.degrees(camera.theta_min)),
        "calibration": dict(camera.calibration),
        "rms_definition": RMS,
        "covariance": None if camera.covariance is None else camera.covariance.tolist(),
        "provenance": dict(camera.provenance),
        # What another tool called by a name of ours keeps its value under a name of its own.
        **{(f"extra_{key}" if key in KEYS else key): value for key, value in camera.extra.items()},
    }


def rig_to_json(rig: Rig) -> dict[str, Any]:
    """Give the rig as the object that the file holds."""
    sensors = {
        name: {
            "sensor_from_rig": {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()},
            "camera": to_json(camera),
        }
        for name, camera, pose in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True)
    }
    return {"format": RIG, "version": VERSION, "convention": "x_sensor = sensor_from_rig x_rig", "sensors": sensors}


def render(camera: Camera | RayCamera) -> tuple[str, tuple[str, ...]]:
    """Give the text; nothing is lost."""
    return json.dumps(to_json(camera), indent=2, allow_nan=False) + "\n", ()
