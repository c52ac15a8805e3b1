"""OpenCV's FileStorage, as its calibration samples and many programs write it: YAML, XML or JSON."""

import re
from collections.abc import Mapping
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
from omnisight.formats._values import build, image_size
from omnisight.formats._yaml import flow

TITLE = "OpenCV storage"
SUFFIX = ".yml"
MODELS = ("kannala_brandt", "mei", "radial_tangential", "rational", "pinhole", "unified")
CONVENTION = "x right, y down, z forward; integer pixel = pixel centre; k1 k2 p1 p2 k3 ..., of a fisheye k1 k2 k3 k4"

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
OTHER_FORMATS = re.compile(r"^(?:model_type|cam\d+|Camera\d?\.\w+)\s*:", re.MULTILINE)
SIZE_NOT_WRITTEN = "the image size is not known and is not written"
KIND = {"fisheye", "fisheyemodel", "distortionmodel", "distortiontype", "cameramodel"}
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
    fisheye = is_fisheye(data[kinds[0]], kinds[0]) if kinds else None
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


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the YAML with OpenCV's newer names."""
    check_supported(camera, MODELS)
    name = camera.model.name
    values = camera.model.to_dict()
    build(name, values)
    lines = ["%YAML:1.0", "---"]
    notes: tuple[str, ...] = (SIZE_NOT_WRITTEN,)
    if all(camera.size):
        lines += [f"image_width: {camera.width}", f"image_height: {camera.height}"]
        notes = ()
    if name not in ("mei", "unified"):
        lines += [f"fisheye_model: {int(name == 'kannala_brandt')}"]
    lines += _matrix("camera_matrix", 3, [value for row in camera_matrix(values) for value in row])
    lines += _matrix("distortion_coefficients", 1, coefficients_of(values, name))
    if "xi" in values:
        lines += [f"xi: {flow(values['xi'])}"]
    return "\n".join(lines) + "\n", notes + dropped_fields(camera)


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
