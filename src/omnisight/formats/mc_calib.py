"""MC-Calib's calibrated_cameras_data.yml.

As written by `Calibration::saveCamerasParams` of MC-Calib: an OpenCV storage with one map per camera; `distortion_type`
is 0 for OpenCV's k1 k2 p1 p2 k3 and 1 for the k1 ... k4 of a fisheye; `camera_pose_matrix` is the inverse of the pose
that it estimates, so reference_from_camera. Lengths have the unit of the board's squares.
"""

import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import has_lines
from omnisight.formats._export import dropped_fields, export
from omnisight.formats._limits import SEARCHED_CHARS
from omnisight.formats._opencv_lens import CV2_READERS, camera_matrix, coefficients_of, focal_and_centre, lens, matrix
from omnisight.formats._opencv_storage import read_storage
from omnisight.formats._rigs import cameras_of, check_count, make_rig, pose_of_rows, rig_notes, rows_of_pose, single
from omnisight.formats._values import image_size, mapping, number
from omnisight.formats._yaml import flow
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "MC-Calib calibrated_cameras_data.yml"
SUFFIX = ".yml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; camera_pose_matrix is reference_from_camera, in the unit"
    " of the squares"
)
# Our model: distortion_type and the number of coefficients.
LENSES = {"kannala_brandt": (1, 4), "radial_tangential": (0, 5), "pinhole": (0, 5)}
MODELS = tuple(LENSES)
CAMERA = re.compile(r"camera_(\d{1,9})")
COMMENT = "# {}"
READERS = {model: CV2_READERS[model] for model in MODELS}


def matches(text: str) -> bool:
    """Return whether a line begins with `nb_camera:` and one with `distortion_type:`."""
    head = text[:SEARCHED_CHARS]
    return has_lines(text, "nb_camera") and "camera_pose_matrix" in head


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    return {name: camera for name, (camera, _) in cameras_of(parse_rig(text)).items()}


def parse_rig(text: str) -> Rig:
    """Return the rig of a file in the frame of the reference camera of its group."""
    data = read_storage(text)
    names = [key for key in data if CAMERA.fullmatch(key)]
    check_count(len(names))
    if (count := number(data.get("nb_camera"), "nb_camera")) != len(names):
        raise ValueError(f"nb_camera is {count:g}, and the file holds {len(names)} cameras")
    entries = {name: mapping(data[name], name) for name in names}
    if len(groups := {str(entry.get("camera_group", 0))[:20] for entry in entries.values()}) > 1:
        raise ValueError(
            f"the cameras are in {len(groups)} groups ({', '.join(sorted(groups))}) whose relative pose is not known:"
            " calibrate with images that connect them, or keep the cameras of one group"
        )
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, entry in entries.items():
        try:
            pose = pose_of_rows(entry.get("camera_pose_matrix"), "camera_pose_matrix").inverse()
            sensors[name] = _camera(entry), pose
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return make_rig(sensors)


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig of one camera."""
    return serialize_rig(single(camera))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig; the cameras are numbered."""
    notes: dict[str, tuple[str, ...]] = {}
    lines = ["%YAML:1.0", "---", f"nb_camera: {len(rig)}"]
    for i, (name, (camera, pose)) in enumerate(cameras_of(rig).items()):
        exported = export(camera, MODELS)
        kind, count = LENSES[camera.model.name]
        k = [value for row in camera_matrix(exported.values | {"skew": 0.0}) for value in row]
        coefficients = coefficients_of(exported.values, camera.model.name)[:count]
        lines += [f"camera_{i}:", *_matrix("camera_matrix", 3, k), *_matrix("distortion_vector", 1, coefficients)]
        lines += [f"   distortion_type: {kind}", "   camera_group: 0"]
        lines += [f"   img_width: {exported.size[0]}", f"   img_height: {exported.size[1]}"]
        lines += _matrix("camera_pose_matrix", 4, [v for row in rows_of_pose(pose.inverse()) for v in row])
        notes[name] = exported.notes + dropped_fields(exported.camera)
    return "\n".join(lines) + "\n", rig_notes(rig, notes)


def _camera(entry: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    kind = number(entry.get("distortion_type", 0), "distortion_type")
    if kind not in (0, 1):
        raise ValueError(f"distortion_type must be 0 (perspective) or 1 (fisheye), got {kind:g}")
    coefficients = matrix(entry.get("distortion_vector"), "distortion_vector")[2]
    model = lens(focal_and_centre(entry.get("camera_matrix"), "camera_matrix"), coefficients, fisheye=kind == 1)
    return Camera(model, image_size(entry.get("img_width"), entry.get("img_height")))


def _matrix(name: str, rows: int, values: list[float]) -> list[str]:
    """Return the lines of a storage matrix."""
    head = [f"   {name}: !!opencv-matrix", f"      rows: {rows}", f"      cols: {len(values) // rows}", "      dt: d"]
    return [*head, f"      data: {flow(values)}"]
