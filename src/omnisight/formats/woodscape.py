"""WoodScape's calibration json.

rho(theta) = k1 theta + k2 theta^2 + k3 theta^3 + k4 theta^4 in px, theta in radians; v is stretched by aspect_ratio.
The centre is an offset from the image's middle: cx = width/2 - 0.5 + cx_offset, integer pixel = pixel centre (its
calibration_readme.txt). Sizes are written as 1280.0. `extrinsic` takes the camera's frame (x right, y down, z forward)
to the vehicle's of ISO 8855 (x forward, y left, z up), as a quaternion x y z w and metres.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, picture_size, refuse, with_size
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map

TITLE = "WoodScape json"
SUFFIX = ".json"
MODELS = ("radial_polynomial",)
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; k1 ... k4 in px; centre from the image's middle;"
    " quaternion x y z w"
)
KIND = re.compile(r'"model"\s*:\s*"radial_poly"')
POWERS = ("k1", "k2", "k3", "k4")
KNOWN = {"model", "poly_order", "aspect_ratio", "cx_offset", "cy_offset", "width", "height", *POWERS}


def matches(text: str) -> bool:
    """Say whether this is JSON with a radial_poly."""
    return text.lstrip().startswith("{") and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    given = data.get("intrinsic")
    if not isinstance(given, dict):
        raise ValueError("intrinsic must hold names and values")
    if given.get("poly_order", 4) != 4:
        raise ValueError(f"poly_order must be 4, got {given['poly_order']!r:.40}")
    size = picture_size(given.get("width"), given.get("height"))
    k = [number(given.get(name), name) for name in POWERS]
    aspect = number(given.get("aspect_ratio"), "aspect_ratio")
    centre = [number(given.get(name), name) for name in ("cx_offset", "cy_offset")]
    values = {
        "fx": k[0],
        "fy": k[0] * aspect,
        "cx": size[0] / 2 - 0.5 + centre[0],
        "cy": size[1] / 2 - 0.5 + centre[1],
        **{name: value / k[0] if k[0] else 0.0 for name, value in zip(POWERS[1:], k[1:], strict=True)},
    }
    name = data.get("name")
    extra = note_unknown(data, {"intrinsic", "name"}) | note_unknown(given, KNOWN)
    return {str(name) if name else "camera": Camera(build("radial_polynomial", values), size, extra=extra)}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with the pose that the camera's file held or none."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    values = camera.model.to_dict()
    build(camera.model.name, values)
    at_vehicle = {"quaternion": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0]}
    intrinsic: dict[str, Any] = {
        "aspect_ratio": values["fy"] / values["fx"],
        "cx_offset": values["cx"] - width / 2 + 0.5,
        "cy_offset": values["cy"] - height / 2 + 0.5,
        "height": float(height),
        "k1": values["fx"],
        **{name: values["fx"] * values[name] for name in POWERS[1:]},
        "model": "radial_poly",
        "poly_order": 4,
        "width": float(width),
    }
    notes: tuple[str, ...] = ()
    if "extrinsic" not in camera.extra:
        notes = ("the camera's place on the vehicle is not known, and written as none",)
    content = {"extrinsic": camera.extra.get("extrinsic", at_vehicle), "intrinsic": intrinsic, "name": "camera"}
    return json.dumps(content, indent=2) + "\n", notes + left_out(camera, ("extrinsic",))
