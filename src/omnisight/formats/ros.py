"""ROS CameraInfo: the yaml that camera_calibration writes, and the message as `rostopic echo` and Foxglove print it.

Integer pixel = pixel centre; px. plumb_bob has OpenCV's k1 k2 p1 p2 k3, rational_polynomial eight, equidistant the
fisheye's k1 ... k4. A stereo
pair is two documents, whose pose follows from R and P (x_rect = R x; P[0, 3] = -f B), as in sensor_msgs/CameraInfo. In
the message the matrices are K, D, R, P (ROS 2: k, d, r, p) and the size is width and height.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from omnisight.formats._rigs import make_rig, pair_of, rig_notes
from omnisight.formats._stereo import array, rectified_pose
from omnisight.formats._values import image_size
from omnisight.formats._yaml import flow, read_map
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

Array = NDArray[np.float64]

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
RECTIFICATION = ("rectification_matrix", "projection_matrix")
# Between baseline and mean viewing direction: three degrees, beyond which a rectified image has no overlap.
MIN_SINE = 0.05
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
NAME = re.compile(r"""(?:^|[{,])[ \t]*["']?(?:camera_name|frame_id)["']?[ \t]*:([^\n,}]*)""", re.MULTILINE)
COMMENT = "# {}"
READERS = CV2_READERS


def matches(text: str) -> bool:
    """Return whether a line begins with `camera_matrix:` and OpenCV wrote no matrix, or whether this is the message."""
    head = text[:SEARCHED_CHARS]
    is_message = all(pattern.search(head) for pattern in MESSAGE_PATTERNS)
    return "opencv-matrix" not in head and (has_lines(text, "camera_matrix") or is_message)


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera: that of a file or of repeated messages, or those of a stereo pair."""
    return _cameras(_documents(text))


def parse_rig(text: str) -> Rig:
    """Return the stereo pair of two documents, of the left and of the right camera, in the frame of the first.

    The rectification of both and the baseline in the projection matrix define the pose.
    """
    documents = _documents(text)
    if len(documents) < 2:
        raise ValueError(
            "no rig: a stereo pair is two documents, of the left and of the right camera, with a line --- between them;"
            " join the files of camera_calibration"
        )
    cameras = _cameras(documents)
    if len(cameras) != 2:
        raise ValueError(f"a stereo pair has two cameras with different camera_name (frame_id), got {len(cameras)}")
    fields = [camera.extra for camera in cameras.values()]
    if missing := sorted({key for key in RECTIFICATION for extra in fields if key not in extra}):
        raise ValueError(f"{' and '.join(missing)} missing: the pose is unknown")
    first, second = (array(extra[RECTIFICATION[0]], RECTIFICATION[0], 9).reshape(3, 3) for extra in fields)
    left, right = (array(extra[RECTIFICATION[1]], RECTIFICATION[1], 12).reshape(3, 4) for extra in fields)
    if not left[:2, 3].any() and not right[:2, 3].any():
        raise ValueError("both projection matrices have no baseline (P[0, 3] = -f B): no stereo calibration")
    pose = rectified_pose(first, second, right) @ rectified_pose(first, first, left).inverse()
    bare = [replace(camera, extra=unknown_fields(camera.extra, RECTIFICATION)) for camera in cameras.values()]
    return make_rig(dict(zip(cameras, zip(bare, (Pose(), pose), strict=True), strict=True)))


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the rectification that its file held."""
    identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    fields, k, notes = _fields(camera)
    fields |= {
        "rectification_matrix": _matrix(3, identity),
        "projection_matrix": _matrix(3, [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0]),
    } | kept_fields(camera, KEPT)
    return _lines(fields), notes


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return two documents, of both cameras of a stereo pair, rectified to parallel cameras side by side."""
    cameras, pose = pair_of(rig)
    baseline = float(np.linalg.norm(pose.translation))
    if not baseline:
        raise ValueError("the cameras have the same position: no stereo pair can be rectified")
    rotations, axis, shift = _rectification(pose)
    parts: list[str] = []
    notes: dict[str, tuple[str, ...]] = {}
    values = cameras[0].model.to_dict()
    focal, plane = values["fx"], (values["cx"], values["cy"])
    for i, (name, camera) in enumerate(zip(rig.names, cameras, strict=True)):
        fields, _, notes[name] = _fields(camera)
        p = [focal, 0.0, plane[0], 0.0, 0.0, focal, plane[1], 0.0, 0.0, 0.0, 1.0, 0.0]
        p[3 + 4 * axis] = focal * shift if i else 0.0
        rectification = _matrix(3, rotations[i].ravel().tolist())
        fields |= {"rectification_matrix": rectification, "projection_matrix": _matrix(3, p)}
        parts.append(_lines(fields | kept_fields(camera, ("binning_x", "binning_y", "roi")) | {"camera_name": name}))
    return "---\n".join(parts), rig_notes(rig, notes)


def _rectification(pose: Pose) -> tuple[tuple[Array, Array], int, float]:
    """Return the rotations to parallel cameras, the axis (0 is x, 1 is y) of the baseline, and its coordinate in there.

    The baseline becomes the axis of the first camera that it is nearest to; the other axes stay close to the mean of
    both cameras, as in `cv2.stereoRectify`.
    """
    to_second = -pose.rotation.T @ pose.translation
    axis = int(np.argmax(np.abs(to_second[:2])))
    length = float(np.linalg.norm(to_second))
    along = to_second / length
    sign = 1.0 if to_second[axis] >= 0 else -1.0
    forward = np.array([0.0, 0.0, 1.0]) + pose.rotation[2]
    across = np.cross(forward, sign * along) if axis == 0 else np.cross(sign * along, forward)
    if np.linalg.norm(across) < MIN_SINE:
        raise ValueError("the baseline is along the viewing direction, or the cameras are back to back: no stereo pair")
    across = across / float(np.linalg.norm(across))
    x, y = (sign * along, across) if axis == 0 else (across, sign * along)
    first: Array = np.stack([x, y, np.cross(x, y)]).astype(float)
    return (first, first @ pose.rotation.T), axis, -sign * length


def _documents(text: str) -> list[str]:
    """Return the documents of a text; `rostopic echo` ends each message with a line of dashes."""
    parts = re.split(r"^---[ \t]*\r?$", text.strip("- \t\r\n"), flags=re.MULTILINE)
    return [part for part in parts if part.strip()]


def _cameras(documents: list[str]) -> dict[str, Camera]:
    """Return the camera of the first document of each name."""
    cameras: dict[str, Camera] = {}
    seen: set[str] = set()
    for document in documents:
        found = NAME.search(document)
        name = found[1].strip() if found else ""
        # Messages repeat, and the last one may be cut off in its header.
        if name in seen or (seen and not name and not matches(document)):
            continue
        seen.add(name)
        cameras |= _named(document)
    return cameras


def _named(text: str) -> dict[str, Camera]:
    """Return the camera of a document under its name."""
    data = _yaml_keys(read_map(text))
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


def _fields(camera: Camera) -> tuple[dict[str, Any], list[float], tuple[str, ...]]:
    """Return the fields of a camera without its rectification, its camera matrix, and what they do not hold."""
    # The skew is left out: ROS ignores it for lenses with coefficients.
    exported = export(camera, MODELS)
    name, (width, height), values = camera.model.name, exported.size, exported.values
    k = [value for row in camera_matrix(values | {"skew": 0.0}) for value in row]
    fields = {
        "image_width": width,
        "image_height": height,
        "camera_name": "camera",
        "camera_matrix": _matrix(3, k),
        "distortion_model": LENSES[name],
        "distortion_coefficients": _matrix(1, coefficients_of(values, name)),
    }
    return fields, k, exported.result("", KEPT)[1]


def _lines(fields: Mapping[str, Any]) -> str:
    return "".join(f"{key}: {flow(value)}\n" for key, value in fields.items())


def _yaml_keys(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a message under the keys of the yaml."""
    if "camera_matrix" in data:
        return dict(data)
    upper = {key.upper() if len(key) == 1 else key: value for key, value in data.items()}
    fields = {MESSAGE_KEYS.get(key, key): value for key, value in upper.items()}
    if isinstance(header := data.get("header"), dict) and header.get("frame_id"):
        fields.setdefault("camera_name", header["frame_id"])
    for key, columns in (("rectification_matrix", 3), ("projection_matrix", 4)):
        if isinstance(value := fields.get(key), list):
            fields[key] = {"rows": 3, "cols": columns, "data": value}
    return fields


def _matrix(rows: int, values: list[float]) -> dict[str, object]:
    return {"rows": rows, "cols": len(values) // rows, "data": values}
