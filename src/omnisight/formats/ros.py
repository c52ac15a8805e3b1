"""ROS CameraInfo: the yaml that camera_calibration writes, and the message as `rostopic echo` and Foxglove show it.

Integer pixel = pixel centre; px. plumb_bob has OpenCV's k1 k2 p1 p2 k3, rational_polynomial eight, equidistant the
fisheye's k1 ... k4. The message calls the matrices K, D, R, P (ROS 2: k, d, r, p) and the size width and height.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, picture_size, refuse, with_size, without
from omnisight.formats._opencv_lens import coefficients_of, focal_and_centre, is_fisheye, lens, matrix
from omnisight.formats._protocol import note_unknown
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
MESSAGE = {
    "K": "camera_matrix",
    "D": "distortion_coefficients",
    "R": "rectification_matrix",
    "P": "projection_matrix",
    "width": "image_width",
    "height": "image_height",
    "frame_id": "camera_name",
}
ECHO = (
    re.compile(r"""(?:^|[{,])[ \t]*["']?[Kk]["']?[ \t]*:[ \t\n]*[\[\-]""", re.MULTILINE),
    re.compile(r"""["']?distortion_model["']?[ \t]*:"""),
)
MATRIX = re.compile(r"^camera_matrix[ \t]*:", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether a line begins with `camera_matrix:` and OpenCV wrote no matrix, or whether this is the message."""
    head = text[:1_000_000]
    return "opencv-matrix" not in head and (MATRIX.search(head) is not None or all(k.search(head) for k in ECHO))


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera."""
    # `rostopic echo` ends each message with a line of dashes.
    data = _named(read_map(re.split(r"^---[ \t]*$", text.strip("- \t\r\n"), maxsplit=1, flags=re.MULTILINE)[0]))
    if data.get("distortion_coefficients") is None:  # the file may be cut off
        raise ValueError("distortion_coefficients are missing; if there are none, add a list of five zeros")
    values = matrix(data["distortion_coefficients"], "distortion_coefficients")[2]
    # Older calibrators wrote camera_model: fisheye alone.
    kind = data.get("distortion_model") or data.get("camera_model")
    model = lens(
        focal_and_centre(data["camera_matrix"], "camera_matrix"),
        values,
        fisheye=None if kind is None else is_fisheye(kind, "distortion_model"),
    )
    size = (0, 0)
    if "image_width" in data or "image_height" in data:
        size = picture_size(data.get("image_width"), data.get("image_height"))
    name = data.get("camera_name")
    return {str(name) if name else "camera": Camera(model, size, extra=note_unknown(data, KNOWN))}


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text; a rectification that the camera's file held is kept."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    # A skew would stand in the camera matrix, where ROS reads it for no lens with coefficients.
    camera, notes = without(camera, [n for n in camera.model.param_names if n != "skew"])
    name, values = camera.model.name, camera.model.to_dict()
    build(name, values)
    k = [values["fx"], 0.0, values["cx"], 0.0, values["fy"], values["cy"], 0.0, 0.0, 1.0]
    identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    extra = {key: camera.extra[key] for key in KEPT if key in camera.extra}
    fields = {
        "image_width": width,
        "image_height": height,
        "camera_name": "camera",
        "camera_matrix": _matrix(3, k),
        "distortion_model": LENSES[name],
        "distortion_coefficients": _matrix(1, coefficients_of(values, name)),
        "rectification_matrix": _matrix(3, identity),
        "projection_matrix": _matrix(3, [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]),
    } | extra
    return "".join(f"{key}: {flow(value)}\n" for key, value in fields.items()), notes + left_out(camera, KEPT)


def _named(data: Mapping[str, Any]) -> dict[str, Any]:
    """Give the fields of a message by the names of the yaml."""
    if "camera_matrix" in data:
        return dict(data)
    upper = {key.upper() if len(key) == 1 else key: value for key, value in data.items()}
    named = {MESSAGE.get(key, key): value for key, value in upper.items()}
    for key, columns in (("rectification_matrix", 3), ("projection_matrix", 4)):
        if isinstance(value := named.get(key), list):
            named[key] = {"rows": 3, "cols": columns, "data": value}
    return named


def _matrix(rows: int, values: list[float]) -> dict[str, object]:
    return {"rows": rows, "cols": len(values) // rows, "data": values}
