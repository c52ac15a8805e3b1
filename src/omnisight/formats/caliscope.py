"""Caliscope's camera_array.toml, its earlier config.toml (also of pyxy3d), and its export for aniposelib.

As in `CameraArray.from_toml` and `to_toml`: `rotation` and `translation` are camera_from_world, the rotation a vector
(radians); a matrix in config.toml of earlier versions. Cameras are `[cameras.0]`, in the other two `[cam_0]`, which has
a `port` in config.toml and a `name` for aniposelib. A fisheye has OpenCV's k1 ... k4, other cameras k1 k2 p1 p2 k3.
`size` is width, height.
"""

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._export import dropped_fields, export, kept_fields, unknown_fields
from omnisight.formats._limits import MAX_TEXT_CHARS, SEARCHED_CHARS
from omnisight.formats._opencv_lens import CV2_READERS, camera_matrix, coefficients_of, focal_and_centre, lens, matrix
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import cameras_of, check_count, make_rig, pose_of_vector, rig_notes, single
from omnisight.formats._values import image_size, mapping, numbers, rotation_matrix
from omnisight.formats._yaml import flow
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "Caliscope camera_array.toml"
SUFFIX = ".toml"
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; rotation (vector) and translation are camera_from_world"
)
LENSES = {"kannala_brandt": 4, "radial_tangential": 5, "pinhole": 5}
MODELS = tuple(LENSES)
TABLE = re.compile(r"^[ \t]*\[[ \t]*(?:cameras[ \t]*\.[ \t]*\"?\d+\"?|cam_\d+)[ \t]*\]", re.MULTILINE)
OLD_TABLE = re.compile(r"cam_(\d{1,9})")
KNOWN = {"cam_id", "port", "name", "size", "matrix", "distortions", "rotation", "translation", "fisheye"}
KEPT = ("rotation_count", "error", "exposure", "grid_count", "ignore")
COMMENT = "# {}"
READERS: Mapping[str, Reader] = {model: CV2_READERS[model] for model in MODELS}


def matches(text: str) -> bool:
    """Return whether a line is the header of a table `[cameras.0]` or `[cam_0]`."""
    return TABLE.search(text[:SEARCHED_CHARS]) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read every calibrated camera."""
    return {name: camera for name, (camera, _) in _sensors(text).items()}


def parse_rig(text: str) -> Rig:
    """Return the rig of a file in the frame of its world."""
    sensors = _sensors(text)
    if missing := [name for name, (_, pose) in sensors.items() if pose is None]:
        raise ValueError(f"{', '.join(missing)[:80]}: no rotation and translation, so the pose is unknown")
    return make_rig({name: (camera, pose) for name, (camera, pose) in sensors.items() if pose is not None})


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of an array of one camera."""
    return serialize_rig(single(camera, "cam_0"))


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of the newest version; the cameras are numbered unless their names are cam_ and a number."""
    numbered = [OLD_TABLE.fullmatch(name) for name in rig.names]
    ids = [int(match[1]) if match else i for i, match in enumerate(numbered)]
    ids = ids if len(set(ids)) == len(ids) else list(range(len(ids)))
    notes: dict[str, tuple[str, ...]] = {}
    lines: list[str] = []
    for key, (name, (camera, pose)) in zip(ids, cameras_of(rig).items(), strict=True):
        exported = export(camera, MODELS)
        kind = camera.model.name
        fields = {
            "cam_id": key,
            "size": list(exported.size),
            "rotation_count": 0,
            "matrix": camera_matrix(exported.values | {"skew": 0.0}),
            "distortions": coefficients_of(exported.values, kind)[: LENSES[kind]],
            "translation": pose.translation.tolist(),
            "rotation": so3.log(pose.rotation).tolist(),
            "fisheye": kind == "kannala_brandt",
            **kept_fields(camera, KEPT),
        }
        lines += [f"[cameras.{key}]", *(f"{field} = {flow(value)}" for field, value in fields.items()), ""]
        notes[name] = exported.notes + dropped_fields(exported.camera, KEPT)
    return "\n".join(lines), rig_notes(rig, notes)


def _sensors(text: str) -> dict[str, tuple[Camera, Pose | None]]:
    """Return the calibrated cameras of any version by name, with their pose if it is known."""
    if len(text) > MAX_TEXT_CHARS:
        raise ValueError(f"{len(text)} characters; at most {MAX_TEXT_CHARS} are read")
    data = tomllib.loads(text)
    if "cameras" in data:
        entries = {f"cam_{key}": entry for key, entry in mapping(data["cameras"], "cameras").items()}
    else:
        entries = {key: entry for key, entry in data.items() if OLD_TABLE.fullmatch(key)}
    check_count(len(entries))
    sensors: dict[str, tuple[Camera, Pose | None]] = {}
    for name, entry in entries.items():
        try:
            sensors[name] = _camera(mapping(entry, "the camera")), _pose(entry)
        except ValueError as error:
            raise ValueError(f"{name[:60]}: {error}") from error
    return sensors


def _camera(entry: Mapping[str, Any]) -> Camera:
    """Return the camera of a table."""
    if missing := [key for key in ("size", "matrix", "distortions") if entry.get(key) is None]:
        raise ValueError(f"{', '.join(missing)} missing: the camera is not calibrated")
    if not isinstance(fisheye := entry.get("fisheye", False), bool):
        raise ValueError(f"fisheye must be true or false, got {fisheye!r:.40}")
    model = lens(
        focal_and_centre(entry["matrix"], "matrix"), matrix(entry["distortions"], "distortions")[2], fisheye=fisheye
    )
    return Camera(model, image_size(*numbers(entry["size"], "size", 2)), extra=unknown_fields(entry, KNOWN))


def _pose(entry: Mapping[str, Any]) -> Pose | None:
    """Return the pose of a table, or None if the camera has none."""
    rotation, translation = entry.get("rotation"), entry.get("translation")
    if rotation is None or translation is None:
        return None
    rows, columns, vector = matrix(translation, "translation")
    if rows * columns != 3:
        raise ValueError(f"translation must have 3 numbers, got {rows * columns}")
    rows, columns, values = matrix(rotation, "rotation")
    if rows * columns == 3:
        return pose_of_vector(values, vector)
    if (rows, columns) != (3, 3):
        raise ValueError(f"rotation must be a vector of 3 numbers or a matrix 3 x 3, got {rows} x {columns}")
    return Pose(rotation_matrix(np.reshape(values, (3, 3)).tolist(), "rotation"), np.array(vector))
