"""omnisight's own JSON."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats._checks import number, numbers
from omnisight.formats._protocol import note_unknown
from omnisight.models import model_class, model_names

TITLE = "omnisight JSON"
SUFFIX = ".json"
MODELS = model_names()
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0); size is [width, height]"
VERSION = 1
_FIRST = {"format", "version", "model", "params", "units", "size", "convention", "theta_max_deg", "theta_min_deg"}
KEYS = _FIRST | {"calibration", "covariance", "provenance", "rms_definition"}
RMS = "root mean square of the residual's length |d|, px, over all corners"


def matches(text: str) -> bool:
    """Say whether this is omnisight's JSON."""
    return text.lstrip().startswith("{") and '"omnisight' in text[:2000]


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data: Any = json.loads(text)
    if data.get("format") != "omnisight-camera":
        raise ValueError(f'"format" is {data.get("format")!r}, not "omnisight-camera"')
    if not isinstance(data.get("version"), int) or data["version"] > VERSION:
        raise ValueError(f"version {data.get('version')!r}; this omnisight reads up to {VERSION}: update it")
    if missing := sorted({"model", "params", "size"} - set(data)):
        raise ValueError(f"missing {', '.join(missing)}")
    size = data["size"]
    if not (isinstance(size, list) and len(size) == 2 and all(isinstance(s, int) and 0 <= s < 10**6 for s in size)):
        raise ValueError(f'"size" must be [width, height], got {size!r}')
    if data["version"] is True or data["version"] < 1:
        raise ValueError(f"version {data['version']!r} is none")
    for name in ("calibration", "provenance"):
        if not isinstance(data.get(name) or {}, dict):
            raise ValueError(f'"{name}" must be an object, got {data[name]!r:.60}')
    model = model_class(data["model"]).from_dict({name: number(value, name) for name, value in data["params"].items()})
    theta_max, theta_min = _cone(data)
    covariance = data.get("covariance")
    camera = Camera(
        model,
        (size[0], size[1]),
        theta_max=theta_max,
        theta_min=theta_min,
        calibration=data.get("calibration") or {},
        covariance=None if covariance is None else _covariance(covariance, len(model.params)),
        provenance=data.get("provenance") or {},
        extra=note_unknown(data, KEYS),
    )
    return {"camera": camera}


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


def to_json(camera: Camera) -> dict[str, Any]:
    """Give the camera as the object that the file holds."""
    return {
        "format": "omnisight-camera",
        "version": VERSION,
        "model": camera.model.name,
        "params": camera.model.to_dict(),
        "units": {p.name: p.unit or "1" for p in camera.model.parameters},
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


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text; nothing is lost."""
    return json.dumps(to_json(camera), indent=2, allow_nan=False) + "\n", ()
