"""OpenCV's FileStorage, as its calibration samples and many programs write it: YAML, XML or JSON."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._export import check_supported, dropped_fields, unknown_fields
from omnisight.formats._limits import HEAD_CHARS, SEARCHED_CHARS
from omnisight.formats._opencv_lens import (
    CV2_READERS,
    camera_matrix,
    coefficients_of,
    focal_and_centre,
    is_fisheye,
    lens,
    matrix,
)
from omnisight.formats._opencv_storage import read_storage
from omnisight.formats._rigs import make_rig, pair_of, rig_notes
from omnisight.formats._stereo import STEREO_KEYS, check_stereo, stereo_pose
from omnisight.formats._values import build, image_size
from omnisight.formats._yaml import flow
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

TITLE = "OpenCV storage"
SUFFIX = ".yml"
MODELS = ("kannala_brandt", "mei", "radial_tangential", "rational", "pinhole", "unified")
CONVENTION = (
    "x right, y down, z forward; integer pixel = pixel centre; k1 k2 p1 p2 k3 ..., of a fisheye k1 k2 k3 k4;"
    " R, T: second_from_first"
)

# Names in lower case without underscores; a stereo pair appends 1 and 2, or left and right.
SIDE = r"(\d?|left|right|l|r)"
MATRIX = re.compile(rf"(?:cameramatrix|intrinsicmatrix|cameraintrinsics?|intrinsics?|mtx|k|m){SIDE}")
DISTORTION = re.compile(
    rf"(?:distortioncoefficients?|distortioncoeffs?|distcoeffs?|distcoefs?|distortion|dist|d){SIDE}"
)
XI = re.compile(rf"xi{SIDE}")
WIDTH = {"imagewidth", "width", "imgwidth", "framewidth"}
HEIGHT = {"imageheight", "height", "imgheight", "frameheight"}
SIZE = {"imagesize", "size", "resolution"}
OTHER_FORMATS = re.compile(r"^(?:model_type|nb_camera|cam\d+|Camera\d?\.\w+)\s*:", re.MULTILINE)
SIZE_NOT_WRITTEN = "the image size is not known and is not written"
KIND = {"fisheye", "fisheyemodel", "distortionmodel", "distortiontype", "cameramodel"}
# Fields of the files of the surround-view program of Zhao Liang, which undistorts by cv2.fisheye and names no model.
SURROUND_VIEW = {"scalexy", "shiftxy"}
COMMENT = "# {}"
READERS = CV2_READERS


def matches(text: str) -> bool:
    """Return whether OpenCV wrote a matrix in it."""
    head = text.lstrip()[:HEAD_CHARS]
    storage = "opencv-matrix" in text or "<opencv_storage" in head
    return storage and '"omnisight-camera"' not in head and OTHER_FORMATS.search(text[:SEARCHED_CHARS]) is None


def parse(text: str) -> Mapping[str, Camera]:
    """Read the camera, or each of a stereo pair."""
    return cameras_of(read_storage(text))


def cameras_of(data: Mapping[str, Any]) -> Mapping[str, Camera]:
    """Return the camera, or each of a stereo pair, from the values of a file by name."""
    plain = {key: re.sub(r"[^a-z0-9]", "", key.lower()) for key in data}
    matrices, distortions, xis = (_by_side(data, plain, name) for name in (MATRIX, DISTORTION, XI))
    if not matrices:
        raise ValueError(f"no camera matrix (camera_matrix, K ...) among {', '.join(list(data)[:20])}")
    size, size_keys = _size(data, plain)
    kinds = [key for key, name in plain.items() if name in KIND]
    is_surround_view = set(plain.values()) >= SURROUND_VIEW
    fisheye = is_fisheye(data[kinds[0]], kinds[0]) if kinds else (is_surround_view or None)
    used = {*matrices.values(), *distortions.values(), *xis.values(), *size_keys, *kinds}
    extra = unknown_fields(data, used)
    cameras: dict[str, Camera] = {}
    for side, key in matrices.items():
        if side not in distortions:  # a truncated file must not silently lose its distortion
            raise ValueError(f"{key} has no distortion coefficients; if there are none, add a list of five zeros")
        values = matrix(data[distortions[side]], distortions[side])[2]
        xi = matrix(data[xis[side]], "xi")[2][0] if side in xis else None
        model = lens(focal_and_centre(data[key], key), values, fisheye=fisheye, xi=xi)
        cameras[f"camera{side}"] = Camera(model, size, extra=extra)
    return cameras


def parse_rig(text: str) -> Rig:
    """Return the stereo pair of a file in the frame of its first camera; R and T map points of it to the second."""
    data = read_storage(text)
    cameras = cameras_of(data)
    if len(cameras) != 2:
        count = "one camera" if len(cameras) == 1 else f"{len(cameras)} cameras"
        raise ValueError(f"no rig but {count}: a stereo pair has two camera matrices (M1, M2)")
    named = {STEREO_KEYS[key.lower()]: value for key, value in data.items() if key.lower() in STEREO_KEYS}
    if missing := sorted({"R", "T"} - set(named)):
        raise ValueError(
            f"no {' and '.join(missing)}: the stereo sample of OpenCV writes them to extrinsics.yml; append its content"
            " to this file"
        )
    pose = stereo_pose(named)
    check_stereo(pose, named)
    bare = [
        replace(c, extra=unknown_fields(c.extra, [k for k in data if k.lower() in STEREO_KEYS]))
        for c in cameras.values()
    ]
    return make_rig(dict(zip(cameras, zip(bare, (Pose(), pose), strict=True), strict=True)))


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the YAML with OpenCV's newer names."""
    check_supported(camera, MODELS)
    lines = ["%YAML:1.0", "---", *_head(camera), *_lens_lines(camera, "camera_matrix", "distortion_coefficients", "xi")]
    notes = () if all(camera.size) else (SIZE_NOT_WRITTEN,)
    return "\n".join(lines) + "\n", notes + dropped_fields(camera)


def serialize_rig(rig: Rig) -> tuple[str, tuple[str, ...]]:
    """Return the YAML of a stereo pair with the names of OpenCV's stereo sample: M1, D1, M2, D2, R, T."""
    (first, second), pose = pair_of(rig)
    for camera in (first, second):
        check_supported(camera, MODELS)
    if first.size != second.size:
        raise ValueError(f"holds one image size, and the cameras have {first.size} and {second.size}: save each alone")
    if _head(first) != _head(second):
        raise ValueError("holds two fisheyes, two plain lenses or two with xi: convert both to the same --model")
    lines = ["%YAML:1.0", "---", *_head(first)]
    lines += [*_lens_lines(first, "M1", "D1", "xi1"), *_lens_lines(second, "M2", "D2", "xi2")]
    lines += [*_matrix("R", 3, pose.rotation.ravel().tolist()), *_matrix("T", 3, pose.translation.tolist())]
    notes = {name: dropped_fields(camera) for name, camera in zip(rig.names, (first, second), strict=True)}
    unknown = () if all(first.size) else (SIZE_NOT_WRITTEN,)
    return "\n".join(lines) + "\n", unknown + rig_notes(rig, notes)


def _head(camera: Camera) -> list[str]:
    """Return the lines of the image size and of the kind of lens."""
    size = [f"image_width: {camera.width}", f"image_height: {camera.height}"] if all(camera.size) else []
    name = camera.model.name
    return size + ([] if name in ("mei", "unified") else [f"fisheye_model: {int(name == 'kannala_brandt')}"])


def _lens_lines(camera: Camera, matrix_name: str, distortion_name: str, xi_name: str) -> list[str]:
    """Return the lines of the numbers of a camera under these names."""
    name, values = camera.model.name, camera.model.to_dict()
    build(name, values)
    lines = _matrix(matrix_name, 3, [value for row in camera_matrix(values) for value in row])
    lines += _matrix(distortion_name, 1, coefficients_of(values, name))
    return lines + ([f"{xi_name}: {flow(values['xi'])}"] if "xi" in values else [])


def _by_side(data: Mapping[str, Any], plain: Mapping[str, str], name: re.Pattern[str]) -> dict[str, str]:
    """Return the keys that a pattern matches, by camera ("", "1", "left" ...)."""
    keys: dict[str, str] = {}
    for key, word in plain.items():
        match = name.fullmatch(word)
        if not match or not (isinstance(data[key], dict | list) or name is XI):  # k1 may also be a coefficient
            continue
        if match[1] in keys:
            raise ValueError(f"both {keys[match[1]]} and {key} are present: remove one")
        keys[match[1]] = key
    return keys


def _size(data: Mapping[str, Any], plain: Mapping[str, str]) -> tuple[tuple[int, int], set[str]]:
    """Return (width, height), or (0, 0) if unknown, and the keys they came from."""
    width = [key for key, name in plain.items() if name in WIDTH]
    height = [key for key, name in plain.items() if name in HEIGHT]
    if width and height:
        return image_size(data[width[0]], data[height[0]]), {width[0], height[0]}
    for key, name in plain.items():
        if name in SIZE:
            sides = data[key]
            if isinstance(sides, dict) and {"width", "height"} <= set(sides):
                sides = [sides["width"], sides["height"]]
            sides = matrix(sides, key)[2]
            if len(sides) == 2:
                return image_size(*sides), {key}
    return (0, 0), set()


def _matrix(name: str, rows: int, values: list[float]) -> list[str]:
    head = [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {len(values) // rows}", "   dt: d"]
    return [*head, f"   data: {flow(values)}"]
