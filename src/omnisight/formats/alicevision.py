"""AliceVision's .sfm json, which Meshroom writes (cameras.sfm, sfm.sfm).

Numbers are written as texts. Since version 1.2.2 the focal length is in mm of the sensor: fx = focalLength/sensorWidth
width px, fy = fx pixelRatio (before 1.2.5, fx/pixelRatio); before that, in px. principalPoint is an offset from the
image's middle (px; before 1.2.1 from its corner), and the centre of the top-left pixel is (0.5, 0.5). Older files say
type and distortion in one word (`fisheye4`). So `jsonIO.cpp`. Angles are radians.

`pinhole` with `fisheye` has OpenCV's k1 ... k4 of a fisheye, with `fisheye1` the FOV model, with `brown` k1 k2 k3 p1
p2. Of `equidistant` the plane is theta/(fov/2), with fov = shorter side of the sensor/focal length, and it is scaled by
fisheyeCircleRadius (px), as `Equidistant.cpp` and `cam2ima` have it: radialk1 and radialk3 act on that plane.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._checks import build, left_out, number, picture_size, refuse, with_size, without
from omnisight.formats._protocol import note_unknown
from omnisight.formats._yaml import read_map, scalar

TITLE = "AliceVision (Meshroom) sfm json"
SUFFIX = ".sfm"
CONVENTION = "the centre of the top-left pixel is (0.5, 0.5); focal length in mm; centre (px) from its middle"
SHIFT = 0.5
# Its distortion of a pinhole, and how older files call both in one word: our model, our names in its order.
PINHOLE: dict[str, tuple[str, tuple[str, ...]]] = {
    "fisheye": ("kannala_brandt", ("k1", "k2", "k3", "k4")),
    "brown": ("radial_tangential", ("k1", "k2", "k3", "p1", "p2")),
    "fisheye1": ("fov", ("omega",)),
    "none": ("pinhole", ()),
    "radialk1": ("radial_tangential", ("k1",)),
    "radialk3": ("radial_tangential", ("k1", "k2", "k3")),
}
OLD = {
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
COEFFICIENTS = {"kannala_brandt": ("k1", "k2", "k3", "k4"), "radial_tangential": ("k1", "k2", "p1", "p2", "k3")}
SENSOR = {"sensorWidth": 36.0, "sensorHeight": 24.0}  # mm, where nothing is said
VERSION = ("1", "2", "13")
ID = "1"
KEY = re.compile(r'"intrinsicId"\s*:')
LIST = re.compile(r'"intrinsics"\s*:')
USED = {
    *("intrinsicId", "width", "height", "type", "distortionType", "distortionParams", "focalLength", "pixelRatio"),
    *("pxFocalLength", "principalPoint", "sensorWidth", "sensorHeight"),
}


def matches(text: str) -> bool:
    """Say whether this is JSON with `intrinsics` and an `intrinsicId`."""
    start = text.lstrip().startswith("{") and '"omnisight' not in text[:2000]
    return start and LIST.search(text) is not None and KEY.search(text) is not None


def parse(text: str) -> Mapping[str, Camera]:
    """Read every intrinsic; its name is its number."""
    data = read_map(text)
    found = data.get("intrinsics")
    if not isinstance(found, list):
        raise ValueError("intrinsics must be a list")
    version = tuple(int(_number(v, "version")) for v in data.get("version") or ())
    if len(version) != 3:
        raise ValueError(f"version must be three numbers, got {str(data.get('version'))[:40]}")
    cameras: dict[str, Camera] = {}
    for i, given in enumerate(found):
        if not isinstance(given, dict):
            raise ValueError(f"intrinsics[{i}] must hold names and values")
        name = str(given.get("intrinsicId", i))
        if name in cameras:
            raise ValueError(f"a second intrinsic {name[:40]}")
        try:
            cameras[name] = _camera(given, version)
        except ValueError as error:
            raise ValueError(f"intrinsic {name[:40]}: {error}") from error
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give a file of one intrinsic, without views and poses."""
    refuse(camera, MODELS)
    size = with_size(camera)
    kind, (_, names) = next((kind, lens) for kind, lens in PINHOLE.items() if lens[0] == camera.model.name)
    camera, notes = without(camera, ["fx", "fy", "cx", "cy", *names])
    values = camera.model.to_dict()
    build(camera.model.name, values)
    middle = [values["cx"] + SHIFT - size[0] / 2, values["cy"] + SHIFT - size[1] / 2]
    sensor = [SENSOR["sensorWidth"], SENSOR["sensorWidth"] * size[1] / size[0]]
    focal = repr(values["fx"] * sensor[0] / size[0])
    intrinsic: dict[str, Any] = {
        "intrinsicId": ID,
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
        "principalPoint": [repr(value) for value in middle],
        "distortionInitializationMode": "calibrated",
        "distortionType": kind,
        "distortionParams": [repr(values[name]) for name in names],
        "locked": "true",
    }
    content = {"version": list(VERSION), "intrinsics": [intrinsic]}
    return json.dumps(content, indent=4) + "\n", notes + left_out(camera)


def _camera(given: Mapping[str, Any], version: tuple[int, ...]) -> Camera:
    size = picture_size(_number(given.get("width"), "width"), _number(given.get("height"), "height"))
    sensor = [_number(given.get(name, default), name) for name, default in SENSOR.items()]
    if not min(sensor) > 0:
        raise ValueError(f"sensorWidth and sensorHeight must be positive (mm), got {sensor[0]:g} and {sensor[1]:g}")
    fx, fy = _focal_lengths(given, version, size[0] / sensor[0])
    centre = _numbers(given.get("principalPoint"), "principalPoint")
    if len(centre) != 2:
        raise ValueError(f"principalPoint must be two numbers, got {len(centre)}")
    middle = (0.0, 0.0) if version < (1, 2, 1) else (size[0] / 2, size[1] / 2)
    plane = {"fx": fx, "fy": fy, "cx": middle[0] + centre[0] - SHIFT, "cy": middle[1] + centre[1] - SHIFT}
    kind, distortion = str(given.get("type")), given.get("distortionType")
    if distortion is None:
        if kind not in OLD:
            raise ValueError(f"no type {kind[:40]!r}; there are {', '.join(OLD)}")
        kind, distortion = OLD[kind]
    k = _numbers(given.get("distortionParams") or [], "distortionParams")
    extra = note_unknown(given, USED)
    if kind == "equidistant":
        return Camera(_equidistant(given, str(distortion), k, plane, size, sensor), size, extra=extra)
    if kind != "pinhole" or distortion not in PINHOLE:
        known = ", ".join(PINHOLE)
        raise ValueError(f"no {kind[:20]} with distortion {str(distortion)[:30]!r} of ours; a pinhole has {known}")
    model, names = PINHOLE[distortion]
    if len(k) != len(names):
        raise ValueError(f"{distortion} has {len(names)} distortionParams ({', '.join(names)}), got {len(k)}")
    own = dict.fromkeys(COEFFICIENTS.get(model, names), 0.0) | dict(zip(names, k, strict=True))
    return Camera(build(model, plane | own | ({"skew": 0.0} if model == "pinhole" else {})), size, extra=extra)


def _equidistant(
    given: Mapping[str, Any],
    distortion: str,
    k: list[float],
    plane: dict[str, float],
    size: tuple[int, int],
    sensor: list[float],
) -> Any:
    if distortion not in EQUIDISTANT or len(k) != len(EQUIDISTANT[distortion]):
        raise ValueError(f"equidistant with {len(k)} of {distortion[:30]!r}; there are {', '.join(EQUIDISTANT)}")
    radius = _number(given.get("fisheyeCircleRadius", given.get("fisheyeRadius")), "fisheyeCircleRadius")
    # radius/(fov/2), fov = shorter side of the sensor / (fx sensorWidth / longer side of the image).
    per_radian = 2 * plane["fx"] * sensor[0] / max(size) / min(sensor)
    powers = {f"k{i + 1}": value * per_radian ** (2 * i + 2) for i, value in enumerate(k)}
    scale = {"fx": radius * per_radian, "fy": radius * per_radian}
    return build("kannala_brandt", dict.fromkeys(COEFFICIENTS["kannala_brandt"], 0.0) | plane | scale | powers)


def _focal_lengths(given: Mapping[str, Any], version: tuple[int, ...], px_per_mm: float) -> tuple[float, float]:
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
