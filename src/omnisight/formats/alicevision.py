"""AliceVision's .sfm json, which Meshroom writes (cameras.sfm, sfm.sfm).

Numbers are written as texts. Since version 1.2.2 the focal length is in mm of the sensor: fx = focalLength/sensorWidth
width px, fy = fx pixelRatio (before 1.2.5, fx/pixelRatio); before that, in px. principalPoint is an offset from the
image centre (px; before 1.2.1 from its corner), and the centre of the top-left pixel is (0.5, 0.5). Older files name
type and distortion in one word (`fisheye4`); see `jsonIO.cpp`. Angles are radians.

`pinhole` with `fisheye` has OpenCV's k1 ... k4 of a fisheye, with `fisheye1` the FOV model, with `brown` k1 k2 k3 p1
p2. The plane of `equidistant` is theta/(fov/2), with fov = shorter side of the sensor/focal length, scaled by
fisheyeCircleRadius (px), as in `Equidistant.cpp` and `cam2ima`: radialk1 and radialk3 act on that plane.
"""

import json
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import export, unknown_fields
from omnisight.formats._readers import Reader
from omnisight.formats._values import HALF_PIXEL, build_with_zeros, image_size, mapping, number
from omnisight.formats._yaml import read_map, scalar
from omnisight.models import CameraModel

TITLE = "AliceVision (Meshroom) sfm json"
SUFFIX = ".sfm"
CONVENTION = (
    "the centre of the top-left pixel is (0.5, 0.5); focal length in mm; principal point (px) from the image centre"
)
# The distortion of a `pinhole`: our model, our names of its coefficients in its order.
PINHOLE: dict[str, tuple[str, tuple[str, ...]]] = {
    "fisheye": ("kannala_brandt", ("k1", "k2", "k3", "k4")),
    "brown": ("radial_tangential", ("k1", "k2", "k3", "p1", "p2")),
    "fisheye1": ("fov", ("omega",)),
    "none": ("pinhole", ()),
    "radialk1": ("radial_tangential", ("k1",)),
    "radialk3": ("radial_tangential", ("k1", "k2", "k3")),
}
# The type of older files: type and distortion.
OLD_TYPES = {
    "fisheye4": ("pinhole", "fisheye"),
    "fisheye": ("pinhole", "fisheye"),
    "fisheye1": ("pinhole", "fisheye1"),
    "brown": ("pinhole", "brown"),
    "radial1": ("pinhole", "radialk1"),
    "radial3": ("pinhole", "radialk3"),
    "pinhole": ("pinhole", "none"),
    "equidistant": ("equidistant", "none"),
    "equidistant_r3": ("equidistant", "radialk3"),
}
EQUIDISTANT = {"none": (), "radialk1": ("k1",), "radialk3": ("k1", "k2", "k3")}
MODELS = ("kannala_brandt", "radial_tangential", "fov", "pinhole")
DEFAULT_SENSOR_MM = {"sensorWidth": 36.0, "sensorHeight": 24.0}
VERSION = ("1", "2", "13")
KNOWN = {
    *("intrinsicId", "width", "height", "type", "distortionType", "distortionParams", "focalLength", "pixelRatio"),
    *("pxFocalLength", "principalPoint", "sensorWidth", "sensorHeight"),
}
COMMENT = ""
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is JSON with `intrinsics` and an `intrinsicId`."""
    return is_json_with(text, "intrinsics") and is_json_with(text, "intrinsicId")


def parse(text: str) -> Mapping[str, Camera]:
    """Read every intrinsic, named by its number."""
    data = read_map(text)
    intrinsics = data.get("intrinsics")
    if not isinstance(intrinsics, list):
        raise ValueError("intrinsics must be a list")
    version = tuple(int(_number(v, "version")) for v in data.get("version") or ())
    if len(version) != 3:
        raise ValueError(f"version must be three numbers, got {str(data.get('version'))[:40]}")
    cameras: dict[str, Camera] = {}
    for i, value in enumerate(intrinsics):
        fields = mapping(value, f"intrinsics[{i}]")
        name = str(fields.get("intrinsicId", i))
        if name in cameras:
            raise ValueError(f"duplicate intrinsic {name[:40]}")
        try:
            cameras[name] = _camera(fields, version)
        except ValueError as error:
            raise ValueError(f"intrinsic {name[:40]}: {error}") from error
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return a file of one intrinsic, without views and poses."""
    kind, names = next(
        ((kind, names) for kind, (model, names) in PINHOLE.items() if model == camera.model.name), ("none", ())
    )
    exported = export(camera, MODELS, ("fx", "fy", "cx", "cy", *names))
    size, values = exported.size, exported.values
    centre = [values["cx"] + HALF_PIXEL - size[0] / 2, values["cy"] + HALF_PIXEL - size[1] / 2]
    width_mm = DEFAULT_SENSOR_MM["sensorWidth"]
    sensor = [width_mm, width_mm * size[1] / size[0]]
    focal = repr(values["fx"] * sensor[0] / size[0])
    intrinsic: dict[str, Any] = {
        "intrinsicId": "1",
        "width": str(size[0]),
        "height": str(size[1]),
        "sensorWidth": repr(sensor[0]),
        "sensorHeight": repr(sensor[1]),
        "serialNumber": "",
        "type": "pinhole",
        "initializationMode": "calibrated",
        "initialFocalLength": focal,
        "focalLength": focal,
        "pixelRatio": repr(values["fy"] / values["fx"]),
        "pixelRatioLocked": "false",
        "principalPoint": [repr(value) for value in centre],
        "distortionInitializationMode": "calibrated",
        "distortionType": kind,
        "distortionParams": [repr(values[name]) for name in names],
        "locked": "true",
    }
    content = {"version": list(VERSION), "intrinsics": [intrinsic]}
    return exported.result(json.dumps(content, indent=4) + "\n")


def _camera(given: Mapping[str, Any], version: tuple[int, ...]) -> Camera:
    size = image_size(_number(given.get("width"), "width"), _number(given.get("height"), "height"))
    sensor = [_number(given.get(name, default), name) for name, default in DEFAULT_SENSOR_MM.items()]
    if not min(sensor) > 0:
        raise ValueError(f"sensorWidth and sensorHeight must be positive (mm), got {sensor[0]:g} and {sensor[1]:g}")
    fx, fy = _focal_lengths(given, version, size[0] / sensor[0])
    centre = _numbers(given.get("principalPoint"), "principalPoint")
    if len(centre) != 2:
        raise ValueError(f"principalPoint must be two numbers, got {len(centre)}")
    origin = (0.0, 0.0) if version < (1, 2, 1) else (size[0] / 2, size[1] / 2)
    plane = {"fx": fx, "fy": fy, "cx": origin[0] + centre[0] - HALF_PIXEL, "cy": origin[1] + centre[1] - HALF_PIXEL}
    kind, distortion = str(given.get("type")), given.get("distortionType")
    if distortion is None:
        if kind not in OLD_TYPES:
            raise ValueError(f"unknown type {kind[:40]!r}; known are {', '.join(OLD_TYPES)}")
        kind, distortion = OLD_TYPES[kind]
    k = _numbers(given.get("distortionParams") or [], "distortionParams")
    extra = unknown_fields(given, KNOWN)
    if kind == "equidistant":
        return Camera(_equidistant(given, str(distortion), k, plane, size, sensor), size, extra=extra)
    if kind != "pinhole" or distortion not in PINHOLE:
        known = ", ".join(PINHOLE)
        raise ValueError(
            f"{kind[:20]} with distortion {str(distortion)[:30]!r} is not supported; a pinhole has {known}"
        )
    model, names = PINHOLE[distortion]
    if len(k) != len(names):
        raise ValueError(f"{distortion} has {len(names)} distortionParams ({', '.join(names)}), got {len(k)}")
    return Camera(build_with_zeros(model, plane | dict(zip(names, k, strict=True))), size, extra=extra)


def _equidistant(
    given: Mapping[str, Any],
    distortion: str,
    k: list[float],
    plane: dict[str, float],
    size: tuple[int, int],
    sensor: list[float],
) -> CameraModel:
    """Return the kannala_brandt model of an `equidistant` intrinsic."""
    if distortion not in EQUIDISTANT or len(k) != len(EQUIDISTANT[distortion]):
        raise ValueError(
            f"equidistant with {len(k)} of {distortion[:30]!r} is not supported; known are {', '.join(EQUIDISTANT)}"
        )
    radius = _number(given.get("fisheyeCircleRadius", given.get("fisheyeRadius")), "fisheyeCircleRadius")
    # radius/(fov/2), fov = shorter side of the sensor / (fx sensorWidth / longer side of the image).
    per_radian = 2 * plane["fx"] * sensor[0] / max(size) / min(sensor)
    powers = {f"k{i + 1}": value * per_radian ** (2 * i + 2) for i, value in enumerate(k)}
    scale = {"fx": radius * per_radian, "fy": radius * per_radian}
    return build_with_zeros("kannala_brandt", plane | scale | powers)


def _focal_lengths(given: Mapping[str, Any], version: tuple[int, ...], px_per_mm: float) -> tuple[float, float]:
    """Return fx and fy (px)."""
    if version < (1, 2, 0):
        focal = _number(given.get("pxFocalLength"), "pxFocalLength")
        return focal, focal
    if version < (1, 2, 2):
        both = _numbers(given.get("pxFocalLength"), "pxFocalLength")
        if len(both) != 2:
            raise ValueError(f"pxFocalLength must be two numbers, got {len(both)}")
        return both[0], both[1]
    focal = _number(given.get("focalLength"), "focalLength") * px_per_mm
    ratio = _number(given.get("pixelRatio", 1.0), "pixelRatio")
    if not ratio > 0:
        raise ValueError(f"pixelRatio must be positive, got {ratio:g}")
    return focal, focal * ratio if version >= (1, 2, 5) else focal / ratio


def _number(value: Any, name: str) -> float:
    return number(scalar(value) if isinstance(value, str) else value, name)


def _numbers(values: Any, name: str) -> list[float]:
    if not isinstance(values, list):
        raise ValueError(f"{name} must be a list of numbers, got {str(values)[:40]}")
    return [_number(value, f"{name}[{i}]") for i, value in enumerate(values)]
