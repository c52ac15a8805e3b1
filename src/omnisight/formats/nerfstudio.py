"""nerfstudio's transforms.json, and Instant-NGP's, which it comes from.

Lengths in px; the centre of the top-left pixel is (0.5, 0.5), as in COLMAP, whose numbers nerfstudio takes over
unchanged (its page on data conventions says the centre is the integer; `Cameras.get_image_coords` adds 0.5). The pose
`transform_matrix` takes the camera's frame to the world's, with OpenGL's axes: x right, y UP, z BACK, so that its
columns 1 and 2 are the negatives of ours; the intrinsics do not know of that. OPENCV has k1 k2 k3 p1 p2, OPENCV_FISHEYE
OpenCV's k1 ... k4. Instant-NGP names no camera_model: `is_fisheye` tells, and `camera_angle_x` (radians) may stand for
fl_x.
"""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import (
    build,
    is_whole_sphere,
    left_out,
    number,
    picture_size,
    refuse,
    whole_sphere,
    with_size,
    without,
)
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map

TITLE = "nerfstudio transforms.json"
SUFFIX = ".json"
CONVENTION = (
    "the centre of the top-left pixel is (0.5, 0.5), so cx and cy are 0.5 larger than ours; poses have y up and z back"
)
SHIFT = 0.5
FISHEYE = ("k1", "k2", "k3", "k4")
BROWN = ("k1", "k2", "p1", "p2", "k3")
# Our model: its name, and its names of the coefficients, which are ours.
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
OWN = {*PLANE, *COEFFICIENTS, "camera_model", "is_fisheye"}
KEPT = ("frames", "fisheye_crop_radius", "applied_transform", "applied_scale", "ply_file_path", "orientation_override")
MOST = 100  # cameras of one file
FRAMES = re.compile(r'"(?:frames|camera_model)"\s*:')
FOCAL = re.compile(r'"(?:fl_x|camera_angle_x)"\s*:|"EQUIRECTANGULAR"')


def matches(text: str) -> bool:
    """Say whether this is JSON with `frames` or a `camera_model`, and `fl_x` or what stands for it."""
    start = text.lstrip().startswith("{") and '"omnisight' not in text[:2000]
    return start and FRAMES.search(text) is not None and FOCAL.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera that the frames share, or each that some of them have, named by its first frame."""
    data = read_map(text)
    kind = data.get("camera_model")
    if kind is None:
        kind = "OPENCV_FISHEYE" if data.get("is_fisheye") is True else "OPENCV"
    frames = data.get("frames")
    frames = [frame for frame in frames if isinstance(frame, dict)] if isinstance(frames, list) else []
    if _tells(data):
        return {"camera": _camera(data, kind, note_unknown(data, OWN))}
    cameras: dict[str, Camera] = {}
    seen: set[str] = set()
    for i, frame in enumerate(frames):
        own = {key: value for key, value in (data | frame).items() if key in OWN}
        if not _tells(own) or (said := json.dumps(own, sort_keys=True)) in seen:
            continue
        if len(seen) == MOST:
            raise ValueError(f"more than {MOST} different cameras in the frames")
        seen.add(said)
        name = str(frame.get("file_path", f"frame{i}"))
        try:
            cameras[name] = _camera(own, kind, note_unknown(data, OWN | {"frames"}))
        except ValueError as error:
            raise ValueError(f"frame {name[:60]!r}: {error}") from error
    if not cameras:
        raise ValueError("neither the file nor a frame of it says fl_x (or camera_angle_x)")
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text, with the frames that the camera's file held or none."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    kind, names = LENSES[camera.model.name]
    notes: tuple[str, ...] = ()
    fields: dict[str, Any] = {"camera_model": kind, "w": width, "h": height}
    if kind == "EQUIRECTANGULAR":
        is_whole_sphere(camera)
        fields |= {"fl_x": width / 2, "fl_y": float(height), "cx": width / 2, "cy": height / 2}
    else:
        camera, notes = without(camera, ["fx", "fy", "cx", "cy", *names])
        values = camera.model.to_dict()
        build(camera.model.name, values)
        fields |= {"fl_x": values["fx"], "fl_y": values["fy"], "cx": values["cx"] + SHIFT, "cy": values["cy"] + SHIFT}
        fields |= {name: values[name] for name in names}
    fields |= {key: camera.extra[key] for key in KEPT if key in camera.extra}
    if "frames" not in fields:
        fields["frames"] = []
        notes += ("no frames are written: their poses are not known",)
    return json.dumps(fields, indent=2) + "\n", notes + left_out(camera, KEPT)


def _tells(data: Mapping[str, Any]) -> bool:
    """Say whether this is enough of a camera."""
    return any(key in data for key in ("fl_x", "camera_angle_x")) or (
        data.get("camera_model") == "EQUIRECTANGULAR" and {"w", "h"} <= set(data)
    )


def _camera(data: Mapping[str, Any], kind: Any, extra: Mapping[str, Any]) -> Camera:
    size = picture_size(data.get("w"), data.get("h"))
    if kind == "EQUIRECTANGULAR":
        return Camera(build("equirectangular", whole_sphere(size)), size, extra=extra)
    if kind != "OPENCV_FISHEYE" and kind not in PERSPECTIVE:
        known = ", ".join(("OPENCV_FISHEYE", "EQUIRECTANGULAR", *sorted(PERSPECTIVE)))
        raise ValueError(f"no camera_model {kind!r:.40} that a model of ours fits; there are {known}")
    fx = _focal(data, "fl_x", "camera_angle_x", size[0], None)
    plane = {
        "fx": fx,
        "fy": _focal(data, "fl_y", "camera_angle_y", size[1], fx),
        "cx": number(data.get("cx", size[0] / 2), "cx") - SHIFT,
        "cy": number(data.get("cy", size[1] / 2), "cy") - SHIFT,
    }
    k = {name: number(data.get(name, 0.0), name) for name in COEFFICIENTS}
    if kind == "OPENCV_FISHEYE":
        if k["p1"] or k["p2"]:
            raise ValueError(f"a fisheye has no p1 and p2, got {k['p1']:g} and {k['p2']:g}")
        return Camera(build("kannala_brandt", plane | {name: k[name] for name in FISHEYE}), size, extra=extra)
    if k["k4"]:
        raise ValueError(f"k4 of {kind} is not supported, got {k['k4']:g}")
    if "PINHOLE" in kind and any(k.values()):
        raise ValueError(f"{kind} has no distortion, got {k}")
    if "PINHOLE" in kind or not any(name in data for name in COEFFICIENTS):
        return Camera(build("pinhole", plane | {"skew": 0.0}), size, extra=extra)
    return Camera(build("radial_tangential", plane | {name: k[name] for name in BROWN}), size, extra=extra)


def _focal(data: Mapping[str, Any], name: str, angle: str, side: int, otherwise: float | None) -> float:
    """Give a focal length (px), from the angle of view (radians) where only that is written."""
    if data.get(name) is not None:
        return number(data[name], name)
    if data.get(angle) is None and otherwise is not None:
        return otherwise
    view = number(data.get(angle), angle)
    if not 0 < view < math.pi:
        raise ValueError(f"{angle} must lie between 0 and pi, got {view:g}")
    return side / 2 / math.tan(view / 2)
