"""multical's calibration.json.

As written by `multical/io/export_calib.py`: K, dist and image_size [width, height] of each camera; `camera_poses` are
camera_from_rig as R and T, and those of a key `a_to_b` transform the frame of camera b to that of a (its
`import_pose_graph`), in the unit of the board.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import dropped_fields, export, unknown_fields
from omnisight.formats._opencv_lens import CV2_READERS, camera_matrix, coefficients_of, focal_and_centre, lens, matrix
from omnisight.formats._rigs import cameras_of, check_count, make_rig, rig_notes, single
from omnisight.formats._values import image_size, mapping, numbers, rotation_matrix
from omnisight.formats._yaml import read_map
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "multical calibration.json"
SUFFIX = ".json"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; camera_poses are camera_from_rig; a_to_b maps points of"
    " camera b to camera a"
)
LENSES = {"radial_tangential": "standard", "rational": "rational", "pinhole": "standard"}
MODELS = tuple(LENSES)
KINDS = ("standard", "rational", "thin_prism", "tilted")
RELATIVE = "_to_"
COMMENT = ""
READERS = {model: CV2_READERS[model] for model in MODELS}


def matches(text: str) -> bool:
    """Return whether this is JSON with `image_size`, K and dist."""
    return all(is_json_with(text, key) for key in ("cameras", "image_size", "K", "dist"))


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    return _cameras(read_map(text))


def parse_rig(text: str) -> Rig:
    """Return the rig of a file."""
    data = read_map(text)
    cameras = _cameras(data)
    if "camera_poses" not in data:
        raise ValueError("no camera_poses: multical calibrate writes them, multical intrinsic does not")
    poses = _absolute(mapping(data["camera_poses"], "camera_poses"), list(cameras))
    return make_rig({name: (camera, poses[name]) for name, camera in cameras.items()})


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig of one camera."""
    return serialize_rig(single(camera))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig."""
    if clashing := [name for name in rig.names if RELATIVE in name]:
        raise ValueError(f"{RELATIVE!r} in the name {clashing[0]!r} means a relative pose here: rename the camera")
    notes: dict[str, tuple[str, ...]] = {}
    cameras: dict[str, Any] = {}
    for name, (camera, _) in cameras_of(rig).items():
        exported = export(camera, MODELS)
        cameras[name] = {
            "model": LENSES[camera.model.name],
            "image_size": list(exported.size),
            "K": camera_matrix(exported.values | {"skew": 0.0}),
            "dist": [coefficients_of(exported.values, camera.model.name)],
        }
        notes[name] = exported.notes + dropped_fields(exported.camera)
    poses = {
        name: {"R": pose.rotation.tolist(), "T": pose.translation.tolist()}
        for name, pose in zip(rig.names, rig.sensor_from_rig, strict=True)
    }
    return json.dumps({"cameras": cameras, "camera_poses": poses}, indent=2) + "\n", rig_notes(rig, notes)


def _cameras(data: Mapping[str, Any]) -> dict[str, Camera]:
    """Return the cameras of a file by name."""
    entries = mapping(data.get("cameras"), "cameras")
    check_count(len(entries))
    cameras: dict[str, Camera] = {}
    for name, entry in entries.items():
        try:
            cameras[name] = _camera(mapping(entry, "the camera"))
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return cameras


def _camera(entry: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    if (kind := entry.get("model", "standard")) not in KINDS:
        raise ValueError(f"unknown model {kind!r:.40}; known are {', '.join(KINDS)}")
    model = lens(focal_and_centre(entry.get("K"), "K"), matrix(entry.get("dist"), "dist")[2], fisheye=False)
    size = image_size(*numbers(entry.get("image_size"), "image_size", 2))
    return Camera(model, size, extra=unknown_fields(entry, {"model", "K", "dist", "image_size"}))


def _absolute(entries: Mapping[str, Any], names: list[str]) -> dict[str, Pose]:
    """Return camera_from_rig of every camera; relative poses are appended to those they refer to."""
    poses: dict[str, Pose] = {}
    relative: dict[str, tuple[str, Pose]] = {}
    for key, entry in entries.items():
        pose, (name, _, other) = _pose(mapping(entry, key[:60]), key[:60]), key.partition(RELATIVE)
        if key in names or not other:
            poses[key] = pose
        else:
            relative[name] = other, pose
    while ready := [name for name, (other, _) in relative.items() if other in poses]:
        for name in ready:
            other, pose = relative.pop(name)
            poses[name] = pose @ poses[other]
    if missing := [name for name in names if name not in poses]:
        raise ValueError(f"no pose of {', '.join(missing)[:80]} in camera_poses")
    return poses


def _pose(entry: Mapping[str, Any], name: str) -> Pose:
    """Return the pose of R and T."""
    return Pose(rotation_matrix(entry.get("R"), f"{name}: R"), np.array(numbers(entry.get("T"), f"{name}: T", 3)))
