"""omnisight's own JSON."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._checks import number
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
    theta = data.get("theta_max_deg")
    covariance = data.get("covariance")
    camera = Camera(
        model_class(data["model"]).from_dict({name: number(value, name) for name, value in data["params"].items()}),
        (size[0], size[1]),
        theta_max=None if theta is None else float(np.radians(theta)),
        theta_min=float(np.radians(data.get("theta_min_deg") or 0.0)),
        calibration=data.get("calibration") or {},
        covariance=None if covariance is None else np.array(covariance, float),
        provenance=data.get("provenance") or {},
        extra=note_unknown(data, KEYS),
    )
    return {"camera": camera}


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
