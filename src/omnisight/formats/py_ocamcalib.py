"""py-OCamCalib's json: Scaramuzza's model with z forward.

`taylor_coefficient` is a0 a1 a2 ..., lowest first, a0 > 0 (px^(1-i), integer pixel = pixel centre); `distortion_center`
is x, y, and `stretch_matrix` [c d; e 1] acts on x, y. `inverse_poly` is highest first and in the angle of incidence
(radians); read, it is not needed. The file holds no size of the image: `image_size` is our addition, which its reader
passes over. `valid`, `img_path` and `extrinsics_t` differ in length and cannot be matched; they are kept as they are.
"""

import json
import re
from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._checks import left_out, numbers, picture_size, refuse, with_size
from omnisight.formats._protocol import note_unknown
from omnisight.formats._scaramuzza import INVERSE_PX, incidence_polynomial, model_of_xy, picture_radius, xy_of_model
from omnisight.formats._yaml import read_map
from omnisight.models.ocam import Ocam

TITLE = "py-OCamCalib json"
SUFFIX = ".json"
MODELS = ("ocam",)
CONVENTION = "x right, y down, z forward, so a0 > 0; centre as x, y; stretch on x, y; integer pixel = pixel centre"
KEY = re.compile(r'"taylor_coefficient"\s*:')
KNOWN = {"taylor_coefficient", "distortion_center", "stretch_matrix", "inverse_poly", "image_size"}
STRAIGHT = 1e-12


def matches(text: str) -> bool:
    """Say whether this is JSON with a `taylor_coefficient`."""
    return text.lstrip().startswith("{") and '"omnisight' not in text[:2000] and KEY.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    centre = numbers(data.get("distortion_center"), "distortion_center", 2)
    rows = data.get("stretch_matrix")
    if not isinstance(rows, list) or len(rows) != 2:
        raise ValueError(f"stretch_matrix must be 2 x 2, got {str(rows)[:60]}")
    (c, d), (e, one) = (numbers(row, "stretch_matrix", 2) for row in rows)
    if abs(one - 1) > STRAIGHT:
        raise ValueError(f"stretch_matrix must be [c d; e 1], got {one:g} in place of 1")
    direct = numbers(data["taylor_coefficient"], "taylor_coefficient")
    model = model_of_xy(direct, cx=centre[0], cy=centre[1], c=c, d=d, e=e)
    size = picture_size(*numbers(data["image_size"], "image_size", 2)) if "image_size" in data else (0, 0)
    name = data.get("camera_name")
    return {str(name) if name else "camera": Camera(model, size, extra=note_unknown(data, KNOWN))}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with an inverse polynomial fitted anew."""
    refuse(camera, MODELS, "convert it with --model ocam")
    size = with_size(camera)
    model = cast(Ocam, camera.model)
    direct, c, d, e = xy_of_model(model)
    model_of_xy(direct, cx=model.cx, cy=model.cy, c=c, d=d, e=e)
    inverse, error = incidence_polynomial(model, picture_radius(model, size), scale=model.c)
    notes: tuple[str, ...] = ()
    if error > INVERSE_PX:
        notes = (f"the inverse polynomial is {error:.2g} px off at most: programs that project with it are, too",)
    rms = camera.calibration.get("rms")
    fields: dict[str, Any] = {
        "date": str(camera.extra.get("date", "")),
        "camera_name": str(camera.extra.get("camera_name", "camera")),
        "valid": camera.extra.get("valid", []),
        "taylor_coefficient": direct,
        "distortion_center": [model.cx, model.cy],
        "stretch_matrix": [[c, d], [e, 1.0]],
        "inverse_poly": [float(value) for value in np.flip(inverse)],
        "extrinsics_t": camera.extra.get("extrinsics_t", []),
        "img_path": camera.extra.get("img_path", []),
        "rms_overall": camera.extra.get("rms_overall", rms if isinstance(rms, int | float) else 0.0),
        "rms_mean_list": camera.extra.get("rms_mean_list", []),
        "rms_std_list": camera.extra.get("rms_std_list", []),
        "image_size": list(size),
    }
    return json.dumps(fields, indent=4) + "\n", notes + left_out(camera, tuple(fields))
