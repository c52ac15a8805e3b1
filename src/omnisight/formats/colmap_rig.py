"""COLMAP's rig_config.json, the input of `colmap rig_configurator`.

As in COLMAP's page on rigs: a list of rigs of cameras, of which one has `ref_sensor`; `cam_from_rig_rotation` is a
quaternion wxyz. `camera_model_name` and `camera_params` are those of cameras.txt, pixel origin included. The format has
no image size; this program adds `size`, which COLMAP ignores, to read its own files back.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omnisight.camera import Camera
from omnisight.formats import colmap
from omnisight.formats._export import dropped_fields, unknown_fields
from omnisight.formats._limits import HEAD_CHARS
from omnisight.formats._rigs import (
    cameras_of,
    check_count,
    in_first_frame,
    make_rig,
    pose_of_quaternion,
    rig_notes,
    single,
)
from omnisight.formats._values import image_size, numbers
from omnisight.formats._yaml import read
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import quaternions
from omnisight.rig import Rig

TITLE = "COLMAP rig_config.json"
SUFFIX = ".json"
CONVENTION = (
    "x right, y down, z forward; the centre of the top-left pixel is (0.5, 0.5); cam_from_rig: quaternion wxyz,"
    " translation; the reference sensor is the rig frame"
)
MODELS = colmap.MODELS
KNOWN = {
    *("image_prefix", "ref_sensor", "cam_from_rig_rotation", "cam_from_rig_translation"),
    *("camera_model_name", "camera_params", "size"),
}
SIZE_UNKNOWN = [1, 1]  # the model does not depend on it
COMMENT = ""
READERS = colmap.READERS


def matches(text: str) -> bool:
    """Return whether this is a JSON list whose entries have an `image_prefix`."""
    return text.lstrip().startswith("[") and '"image_prefix"' in text[:HEAD_CHARS]


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    return {name: camera for name, (camera, _) in cameras_of(parse_rig(text)).items()}


def parse_rig(text: str) -> Rig:
    """Return the rig of a file in the frame of its reference sensor."""
    data = read(text)
    if not isinstance(data, list) or len(data) != 1 or not isinstance(data[0], dict):
        count = len(data) if isinstance(data, list) else 0
        raise ValueError(f"must be a list of one rig with cameras, got {count} rigs: keep one of them in the file")
    entries = data[0].get("cameras")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ValueError("cameras must be a list of cameras")
    check_count(len(entries))
    if (count := sum(entry.get("ref_sensor") is True for entry in entries)) != 1:
        raise ValueError(f"one camera must have ref_sensor: true, got {count}")
    names = _names([str(entry.get("image_prefix", "")) for entry in entries])
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, entry in zip(names, entries, strict=True):
        try:
            sensors[name] = _camera(entry), _pose(entry)
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return make_rig(sensors)


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig of one camera."""
    return serialize_rig(single(camera))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig in the frame of its reference sensor; the cameras name the folders of the images."""
    posed, frame_note = (rig, ()) if rig.reference else in_first_frame(rig)
    notes: dict[str, tuple[str, ...]] = {}
    cameras: list[dict[str, Any]] = []
    for name, (camera, pose) in cameras_of(posed).items():
        exported, kind, params = colmap.colmap_camera(camera)
        entry: dict[str, Any] = {"image_prefix": camera.extra.get("image_prefix", f"{name}/")}
        if name == posed.reference:
            entry["ref_sensor"] = True
        else:
            x, y, z, w = quaternions(pose.rotation).tolist()
            entry |= {"cam_from_rig_rotation": [w, x, y, z], "cam_from_rig_translation": pose.translation.tolist()}
        cameras.append(entry | {"camera_model_name": kind, "camera_params": params, "size": list(exported.size)})
        notes[name] = exported.notes + dropped_fields(exported.camera, ("image_prefix",))
    return json.dumps([{"cameras": cameras}], indent=2) + "\n", frame_note + rig_notes(posed, notes)


def _names(prefixes: list[str]) -> list[str]:
    """Return names from the folders of the images: their last part if that is unique, else the whole."""
    last = [prefix.strip("/").rpartition("/")[2] or f"cam{i}" for i, prefix in enumerate(prefixes)]
    if len(set(last)) == len(last):
        return last
    if len(set(prefixes)) < len(prefixes):
        raise ValueError(f"duplicate image_prefix {next(p for p in prefixes if prefixes.count(p) > 1)[:60]!r}")
    return [prefix.strip("/") for prefix in prefixes]


def _camera(entry: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    kind, params = entry.get("camera_model_name"), entry.get("camera_params")
    if kind is None or params is None:
        raise ValueError(
            "no camera_model_name and camera_params: this rig_config.json leaves the cameras to the database of COLMAP;"
            " add them from cameras.txt"
        )
    size = entry.get("size")
    sides = image_size(*numbers(size, "size", 2)) if size is not None else tuple(SIZE_UNKNOWN)
    words = ["1", str(kind), *map(str, sides), *map(repr, numbers(params, "camera_params"))]
    camera = next(iter(colmap.parse(" ".join(words)).values()))
    prefix = {"image_prefix": entry["image_prefix"]} if "image_prefix" in entry else {}
    extra = {**unknown_fields(entry, KNOWN), **prefix}
    return replace(camera, size=camera.size if size is not None else (0, 0), extra=extra)


def _pose(entry: Mapping[str, Any]) -> Pose:
    """Return sensor_from_rig of an entry."""
    if entry.get("ref_sensor") is True:
        return Pose()
    w, x, y, z = numbers(entry.get("cam_from_rig_rotation"), "cam_from_rig_rotation", 4)
    translation = numbers(entry.get("cam_from_rig_translation"), "cam_from_rig_translation", 3)
    return pose_of_quaternion((x, y, z, w), translation, "cam_from_rig_rotation")
