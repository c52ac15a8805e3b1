"""nerfstudio's transforms.json, and Instant-NGP's, which it comes from.

Lengths in px; the centre of the top-left pixel is (0.5, 0.5), as in COLMAP, whose numbers nerfstudio uses unchanged
(its page on data conventions has integer centres, but `Cameras.get_image_coords` adds 0.5). `transform_matrix` is
world_from_cam with OpenGL's axes (x right, y UP, z BACK): its columns 1 and 2 are the negatives of ours; the intrinsics
are not affected. OPENCV has k1 k2 k3 p1 p2, OPENCV_FISHEYE OpenCV's k1 ... k4. Instant-NGP has `is_fisheye` in place of
camera_model, and may have `camera_angle_x` (radians) in place of fl_x.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import check_whole_sphere, export, kept_fields, unknown_fields
from omnisight.formats._limits import MAX_DISTINCT_CAMERAS
from omnisight.formats._readers import Reader
from omnisight.formats._rigs import cameras_of, check_count, make_rig, pose_of_rows, rig_notes, rows_of_pose
from omnisight.formats._values import HALF_PIXEL, build, build_with_zeros, image_size, number, whole_sphere
from omnisight.formats._yaml import read_map
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "nerfstudio transforms.json"
SUFFIX = ".json"
CONVENTION = (
    "the centre of the top-left pixel is (0.5, 0.5), so cx and cy are 0.5 larger than ours; poses have y up and z back"
)
FISHEYE = ("k1", "k2", "k3", "k4")
BROWN = ("k1", "k2", "p1", "p2", "k3")
# Our model: the name here, and the coefficients, whose names are the same.
LENSES: dict[str, tuple[str, tuple[str, ...]]] = {
    "kannala_brandt": ("OPENCV_FISHEYE", FISHEYE),
    "radial_tangential": ("OPENCV", BROWN),
    "pinhole": ("PINHOLE", ()),
    "equirectangular": ("EQUIRECTANGULAR", ()),
}
MODELS = tuple(LENSES)
PERSPECTIVE = {"SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}
PLANE = ("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", "camera_angle_y")
COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
KNOWN = {*PLANE, *COEFFICIENTS, "camera_model", "is_fisheye"}
KEPT = ("frames", "fisheye_crop_radius", "applied_transform", "applied_scale", "ply_file_path", "orientation_override")
AXES = np.diag([1.0, -1.0, -1.0])  # our axes from OpenGL's
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with `frames` or a `camera_model`, and `fl_x` or its replacement."""
    has_focal = is_json_with(text, "fl_x", "camera_angle_x") or '"EQUIRECTANGULAR"' in text
    return has_focal and is_json_with(text, "frames", "camera_model")


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera that all frames share, or the distinct cameras of frames, each named by its first frame."""
    data = read_map(text)
    kind = data.get("camera_model")
    if kind is None:
        kind = "OPENCV_FISHEYE" if data.get("is_fisheye") is True else "OPENCV"
    frames = data.get("frames")
    frames = [frame for frame in frames if isinstance(frame, dict)] if isinstance(frames, list) else []
    if _has_camera(data):
        return {"camera": _camera(data, kind, unknown_fields(data, KNOWN))}
    cameras: dict[str, Camera] = {}
    seen: set[str] = set()
    for i, frame in enumerate(frames):
        own = {key: value for key, value in (data | frame).items() if key in KNOWN}
        if not _has_camera(own) or (key := json.dumps(own, sort_keys=True)) in seen:
            continue
        if len(seen) == MAX_DISTINCT_CAMERAS:
            raise ValueError(f"more than {MAX_DISTINCT_CAMERAS} different cameras in the frames")
        seen.add(key)
        name = str(frame.get("file_path", f"frame{i}"))
        try:
            cameras[name] = _camera(own, kind, unknown_fields(data, KNOWN | {"frames"}))
        except ValueError as error:
            raise ValueError(f"frame {name[:60]!r}: {error}") from error
    if not cameras:
        raise ValueError("neither the file nor its frames have fl_x (or camera_angle_x)")
    return cameras


def parse_rig(text: str) -> Rig:
    """Return the rig of a file of one instant: each frame is another camera and has its own intrinsics."""
    data = read_map(text)
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise ValueError("no rig: frames must be a list of images with a transform_matrix")
    if not all(_has_camera(frame) for frame in frames):
        raise ValueError(
            "no rig: its frames share one camera, so they are images of a moving camera; in a rig each frame"
            " has its own fl_x, fl_y, cx, cy, w and h"
        )
    check_count(len(frames))
    kind = data.get("camera_model", "OPENCV")
    names = _frame_names(frames)
    sensors: dict[str, tuple[Camera, Pose]] = {}
    for name, frame in zip(names, frames, strict=True):
        try:
            own = {key: value for key, value in (data | frame).items() if key in KNOWN}
            path = {"file_path": frame["file_path"]} if "file_path" in frame else {}
            camera = _camera(own, frame.get("camera_model", kind), path)
            sensors[name] = (
                camera,
                Pose(AXES) @ pose_of_rows(frame.get("transform_matrix"), "transform_matrix").inverse(),
            )
        except ValueError as error:
            raise ValueError(f"frame {name[:60]!r}: {error}") from error
    return make_rig(sensors)


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of the camera with the frames that its file held."""
    fields, notes = _fields(camera)
    fields |= {"frames": []} | kept_fields(camera, KEPT)
    notes += () if "frames" in camera.extra else ("no frames are written: their poses are not known",)
    return json.dumps(fields, indent=2) + "\n", notes


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the text of a rig at one instant, a frame for each camera; the world is the rig frame."""
    frames: list[dict[str, Any]] = []
    notes: dict[str, tuple[str, ...]] = {}
    for name, (camera, pose) in cameras_of(rig).items():
        fields, notes[name] = _fields(camera)
        path = camera.extra.get("file_path", f"images/{name}.jpg")
        frames.append({"file_path": path, **fields, "transform_matrix": rows_of_pose((Pose(AXES) @ pose).inverse())})
    kinds = {frame["camera_model"] for frame in frames}
    if len(kinds) > 1:
        raise ValueError(f"holds one camera model, and the rig has {', '.join(sorted(kinds))}: specify --model")
    for frame in frames:
        del frame["camera_model"]
    return json.dumps({"camera_model": kinds.pop(), "frames": frames}, indent=2) + "\n", rig_notes(rig, notes)


def _frame_names(frames: list[dict[str, Any]]) -> list[str]:
    """Return names of frames from their files: without folder and ending if these are unique, else the whole path."""
    paths = [str(frame.get("file_path", f"frame{i}")) for i, frame in enumerate(frames)]
    stems = [path.rpartition("/")[2].rpartition(".")[0] or path for path in paths]
    names = stems if len(set(stems)) == len(stems) else paths
    if len(set(names)) < len(names):
        raise ValueError(f"duplicate file_path {next(n for n in names if names.count(n) > 1)[:60]!r}")
    return names


def _fields(camera: Camera) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the fields of a camera and what they do not hold."""
    kind, names = LENSES.get(camera.model.name, ("", ()))
    exported = export(camera, MODELS, ["fx", "fy", "cx", "cy", *names])
    (width, height), values = exported.size, exported.values
    fields: dict[str, Any] = {"camera_model": kind, "w": width, "h": height}
    if kind == "EQUIRECTANGULAR":
        check_whole_sphere(camera)
        fields |= {"fl_x": width / 2, "fl_y": float(height), "cx": width / 2, "cy": height / 2}
    else:
        fields |= {"fl_x": values["fx"], "fl_y": values["fy"]}
        fields |= {name: values[name] + HALF_PIXEL for name in ("cx", "cy")}
        fields |= {name: values[name] for name in names}
    return fields, exported.result("", (*KEPT, "file_path"))[1]


def _has_camera(data: Mapping[str, Any]) -> bool:
    """Return whether these fields define a camera."""
    return any(key in data for key in ("fl_x", "camera_angle_x")) or (
        data.get("camera_model") == "EQUIRECTANGULAR" and {"w", "h"} <= set(data)
    )


def _camera(data: Mapping[str, Any], kind: Any, extra: Mapping[str, Any]) -> Camera:
    size = image_size(data.get("w"), data.get("h"))
    if kind == "EQUIRECTANGULAR":
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    if kind != "OPENCV_FISHEYE" and kind not in PERSPECTIVE:
        known = ", ".join(("OPENCV_FISHEYE", "EQUIRECTANGULAR", *sorted(PERSPECTIVE)))
        raise ValueError(f"unknown camera_model {kind!r:.40}; known are {known}")
    fx = _focal(data, "fl_x", "camera_angle_x", size[0], None)
    plane = {
        "fx": fx,
        "fy": _focal(data, "fl_y", "camera_angle_y", size[1], fx),
        "cx": number(data.get("cx", size[0] / 2), "cx") - HALF_PIXEL,
        "cy": number(data.get("cy", size[1] / 2), "cy") - HALF_PIXEL,
    }
    k = {name: number(data.get(name, 0.0), name) for name in COEFFICIENTS}
    if kind == "OPENCV_FISHEYE":
        if k["p1"] or k["p2"]:
            raise ValueError(f"OPENCV_FISHEYE has no p1 and p2, got {k['p1']:g} and {k['p2']:g}")
        return Camera(build("kannala_brandt", plane | {name: k[name] for name in FISHEYE}), size, extra=extra)
    if k["k4"]:
        raise ValueError(f"k4 of {kind} is not supported, got {k['k4']:g}")
    if "PINHOLE" in kind and any(k.values()):
        raise ValueError(f"{kind} has no distortion, got {k}")
    if "PINHOLE" in kind or not any(name in data for name in COEFFICIENTS):
        return Camera(build_with_zeros("pinhole", plane), size, extra=extra)
    return Camera(build("radial_tangential", plane | {name: k[name] for name in BROWN}), size, extra=extra)


def _focal(data: Mapping[str, Any], name: str, angle: str, side: int, default: float | None) -> float:
    """Return a focal length (px), from the angle of view (radians) if the file has only that."""
    if data.get(name) is not None:
        return number(data[name], name)
    if data.get(angle) is None and default is not None:
        return default
    view = number(data.get(angle), angle)
    if not 0 < view < math.pi:
        raise ValueError(f"{angle} must lie between 0 and pi, got {view:g}")
    return side / 2 / math.tan(view / 2)
