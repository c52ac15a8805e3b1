"""ROS CameraInfo: the yaml that camera_calibration writes, and the message as `rostopic echo` and Foxglove print it.

Integer pixel = pixel centre; px. plumb_bob has OpenCV's k1 k2 p1 p2 k3, rational_polynomial eight, equidistant the
fisheye's k1 ... k4. In the message the matrices are K, D, R, P (ROS 2: k, d, r, p) and the size is width and height.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import export, kept_fields, unknown_fields
from omnisight.formats._limits import SEARCHED_CHARS
from omnisight.formats._opencv_lens import (
    CV2_READERS,
    camera_matrix,
    coefficients_of,
    focal_and_centre,
    is_fisheye,
    lens,
    matrix,
)
from omnisight.formats._values import image_size
from omnisight.formats._yaml import flow, read_map

TITLE = "ROS CameraInfo yaml"
SUFFIX = ".yaml"
LENSES = {
    "kannala_brandt": "equidistant",
    "radial_tangential": "plumb_bob",
    "rational": "rational_polynomial",
    "pinhole": "plumb_bob",
}
MODELS = tuple(LENSES)
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; coefficients k1 k2 p1 p2 k3 ..., equidistant k1 k2 k3 k4"
)
KNOWN = {"image_width", "image_height", "camera_matrix", "distortion_model", "camera_model", "distortion_coefficients"}
KEPT = ("camera_name", "rectification_matrix", "projection_matrix", "binning_x", "binning_y", "roi")
MESSAGE_KEYS = {
    "K": "camera_matrix",
    "D": "distortion_coefficients",
    "R": "rectification_matrix",
    "P": "projection_matrix",
    "width": "image_width",
    "height": "image_height",
    "frame_id": "camera_name",
}
MESSAGE_PATTERNS = (
    re.compile(r"""(?:^|[{,])[ \t]*["']?[Kk]["']?[ \t]*:[ \t\n]*[\[\-]""", re.MULTILINE),
    re.compile(r"""["']?distortion_model["']?[ \t]*:"""),
)
COMMENT = "# {}"
READERS = CV2_READERS


def matches(text: str) -> bool:
    """Return whether a line begins with `camera_matrix:` and OpenCV wrote no matrix, or whether this is the message."""
    head = text[:SEARCHED_CHARS]
    is_message = all(pattern.search(head) for pattern in MESSAGE_PATTERNS)
    return "opencv-matrix" not in head and (has_lines(text, "camera_matrix") or is_message)


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    # `rostopic echo` ends each message with a line of dashes.
    data = _yaml_keys(read_map(re.split(r"^---[ \t]*$", text.strip("- \t\r\n"), maxsplit=1, flags=re.MULTILINE)[0]))
    if data.get("distortion_coefficients") is None:  # the file may be truncated
        raise ValueError("distortion_coefficients are missing; if there are none, add a list of five zeros")
    values = matrix(data["distortion_coefficients"], "distortion_coefficients")[2]
    # Older calibrators wrote only camera_model: fisheye.
    kind = data.get("distortion_model") or data.get("camera_model")
    model = lens(
        focal_and_centre(data["camera_matrix"], "camera_matrix"),
        values,
        fisheye=None if kind is None else is_fisheye(kind, "distortion_model"),
    )
    size = (0, 0)
    if "image_width" in data or "image_height" in data:
        size = image_size(data.get("image_width"), data.get("image_height"))
    name = data.get("camera_name")
    return {str(name) if name else "camera": Camera(model, size, extra=unknown_fields(data, KNOWN))}


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the rectification that its file held."""
    # The skew is left out: ROS ignores it for lenses with coefficients.
    exported = export(camera, MODELS)
    name, (width, height), values = camera.model.name, exported.size, exported.values
    k = [value for row in camera_matrix(values | {"skew": 0.0}) for value in row]
    identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    fields = {
        "image_width": width,
        "image_height": height,
        "camera_name": "camera",
        "camera_matrix": _matrix(3, k),
        "distortion_model": LENSES[name],
        "distortion_coefficients": _matrix(1, coefficients_of(values, name)),
        "rectification_matrix": _matrix(3, identity),
        "projection_matrix": _matrix(3, [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]),
    } | kept_fields(camera, KEPT)
    return exported.result("".join(f"{key}: {flow(value)}\n" for key, value in fields.items()), KEPT)


def _yaml_keys(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a message under the keys of the yaml."""
    if "camera_matrix" in data:
        return dict(data)
    upper = {key.upper() if len(key) == 1 else key: value for key, value in data.items()}
    fields = {MESSAGE_KEYS.get(key, key): value for key, value in upper.items()}
    for key, columns in (("rectification_matrix", 3), ("projection_matrix", 4)):
        if isinstance(value := fields.get(key), list):
            fields[key] = {"rows": 3, "cols": columns, "data": value}
    return fields


def _matrix(rows: int, values: list[float]) -> dict[str, object]:
    return {"rows": rows, "cols": len(values) // rows, "data": values}
