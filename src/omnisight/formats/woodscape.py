"""WoodScape's calibration json.

rho(theta) = k1 theta + k2 theta^2 + k3 theta^3 + k4 theta^4 in px, theta in radians; v is stretched by aspect_ratio.
The principal point is an offset from the image centre: cx = width/2 - 0.5 + cx_offset, integer pixel = pixel centre
(calibration_readme.txt of the data set). Sizes are written as 1280.0. `extrinsic` is vehicle_from_cam, with the
vehicle frame of ISO 8855 (x forward, y left, z up), as a quaternion x y z w and metres.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._values import build, image_size, mapping, number
from omnisight.formats._yaml import read_map

TITLE = "WoodScape json"
SUFFIX = ".json"
MODELS = ("radial_polynomial",)
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; k1 ... k4 in px; principal point from the image centre;"
    " quaternion x y z w"
)
KIND = re.compile(r'"model"\s*:\s*"radial_poly"')
POWERS = ("k1", "k2", "k3", "k4")
KNOWN = {"model", "poly_order", "aspect_ratio", "cx_offset", "cy_offset", "width", "height", *POWERS}
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with a radial_poly."""
    return text.lstrip().startswith("{") and KIND.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    data = read_map(text)
    given = mapping(data.get("intrinsic"), "intrinsic")
    if given.get("poly_order", 4) != 4:
        raise ValueError(f"poly_order must be 4, got {given['poly_order']!r:.40}")
    size = image_size(given.get("width"), given.get("height"))
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
    name = str(data.get("name") or "camera")
    extra = unknown_fields(data, {"intrinsic", "name"}) | unknown_fields(given, KNOWN)
    return {name: Camera(build("radial_polynomial", values), size, extra=extra)}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the pose that its file held."""
    exported = export(camera, MODELS)
    (width, height), values = exported.size, exported.values
    identity = {"quaternion": [0.0, 0.0, 0.0, 1.0], "translation": [0.0, 0.0, 0.0]}
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
    content = {"extrinsic": camera.extra.get("extrinsic", identity), "intrinsic": intrinsic, "name": "camera"}
    text, notes = exported.result(json.dumps(content, indent=2) + "\n", ("extrinsic",))
    if "extrinsic" not in camera.extra:
        notes += ("the pose on the vehicle is not known; the identity is written",)
    return text, notes
