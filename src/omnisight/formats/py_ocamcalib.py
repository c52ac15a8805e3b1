"""py-OCamCalib's json: Scaramuzza's model with z forward.

`taylor_coefficient` is a0 a1 a2 ..., lowest first, a0 > 0 (px^(1-i), integer pixel = pixel centre); `distortion_center`
is x, y, and `stretch_matrix` [c d; e 1] acts on x, y. `inverse_poly` is highest first and in the angle of incidence
(radians); it is not read. The format has no image size: `image_size` is our addition, which py-OCamCalib ignores.
`valid`, `img_path` and `extrinsics_t` differ in length and cannot be matched; they are kept unchanged.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import export_xy, model_of_xy
from omnisight.formats._values import image_size, numbers
from omnisight.formats._yaml import read_map

TITLE = "py-OCamCalib json"
SUFFIX = ".json"
MODELS = ("ocam",)
CONVENTION = "x right, y down, z forward, so a0 > 0; centre as x, y; stretch on x, y; integer pixel = pixel centre"
KNOWN = {"taylor_coefficient", "distortion_center", "stretch_matrix", "inverse_poly", "image_size"}
# What the file holds besides the camera, and its default.
DEFAULTS: dict[str, Any] = {
    "date": "",
    "camera_name": "camera",
    "valid": [],
    "extrinsics_t": [],
    "img_path": [],
    "rms_mean_list": [],
    "rms_std_list": [],
}
ROUNDING = 1e-12  # of the 1 in the stretch matrix
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with a `taylor_coefficient`."""
    return is_json_with(text, "taylor_coefficient")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    cx, cy = numbers(data.get("distortion_center"), "distortion_center", 2)
    rows = data.get("stretch_matrix")
    if not isinstance(rows, list) or len(rows) != 2:
        raise ValueError(f"stretch_matrix must be 2 x 2, got {str(rows)[:60]}")
    (c, d), (e, one) = (numbers(row, "stretch_matrix", 2) for row in rows)
    if abs(one - 1) > ROUNDING:
        raise ValueError(f"stretch_matrix must be [c d; e 1], got {one:g} in place of 1")
    model = model_of_xy(numbers(data["taylor_coefficient"], "taylor_coefficient"), cx=cx, cy=cy, c=c, d=d, e=e)
    size = image_size(*numbers(data["image_size"], "image_size", 2)) if "image_size" in data else (0, 0)
    name = str(data.get("camera_name") or "camera")
    return {name: Camera(model, size, extra=unknown_fields(data, KNOWN))}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with a new inverse polynomial."""
    export = export_xy(camera, fixed_terms=False, incidence=True)
    plane, rms = export.plane, camera.calibration.get("rms")
    default_rms = rms if isinstance(rms, int | float) else 0.0
    fields: dict[str, Any] = {
        "taylor_coefficient": export.direct,
        "distortion_center": [plane["cx"], plane["cy"]],
        "stretch_matrix": [[plane["c"], plane["d"]], [plane["e"], 1.0]],
        "inverse_poly": [float(value) for value in np.flip(export.inverse)],
        **{key: camera.extra.get(key, default) for key, default in DEFAULTS.items()},
        "rms_overall": camera.extra.get("rms_overall", default_rms),
        "image_size": list(export.size),
    }
    return export.result(json.dumps(fields, indent=4) + "\n", tuple(fields))
