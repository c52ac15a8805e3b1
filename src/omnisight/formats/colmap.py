"""COLMAP's cameras.txt, and cameras.bin, which is read.

Lengths in px; the centre of the top-left pixel is (0.5, 0.5). The numbers of cameras.bin's models are those of COLMAP's
own `sensor/models.h`; forks that had EQUIRECTANGULAR before it came in call it 10, 16 or SPHERE.
"""

import math
import re
import struct
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._binary import is_binary, to_bytes
from omnisight.formats._checks import WIDEST, build, left_out, number, picture_size, refuse, with_size, without

TITLE = "COLMAP cameras.txt"
SUFFIX = ".txt"
CONVENTION = (
    "x right, y down, z forward; the centre of the top-left pixel is (0.5, 0.5), so cx and cy are 0.5 larger than ours"
)
SHIFT = 0.5

# COLMAP's name, our model, our names of its parameters in its order; f is fx and fy in one. What a camera lacks is 0.
# Of one model, the most specific name comes first.
NAMES = (
    ("SIMPLE_PINHOLE", "pinhole", "f cx cy"),
    ("PINHOLE", "pinhole", "fx fy cx cy"),
    ("SIMPLE_RADIAL", "radial_tangential", "f cx cy k1"),
    ("RADIAL", "radial_tangential", "f cx cy k1 k2"),
    ("OPENCV", "radial_tangential", "fx fy cx cy k1 k2 p1 p2"),
    ("FULL_OPENCV", "rational", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    ("SIMPLE_FISHEYE", "equidistant", "f cx cy"),
    ("FISHEYE", "equidistant", "fx fy cx cy"),
    ("SIMPLE_RADIAL_FISHEYE", "kannala_brandt", "f cx cy k1"),
    ("RADIAL_FISHEYE", "kannala_brandt", "f cx cy k1 k2"),
    ("OPENCV_FISHEYE", "kannala_brandt", "fx fy cx cy k1 k2 k3 k4"),
    ("FOV", "fov", "fx fy cx cy omega"),
    ("THIN_PRISM_FISHEYE", "thin_prism_fisheye", "fx fy cx cy k1 k2 p1 p2 k3 k4 s1 s2"),
    ("RAD_TAN_THIN_PRISM_FISHEYE", "fisheye624", "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4"),
    ("SIMPLE_DIVISION", "division", "f cx cy k"),
    ("DIVISION", "division", "fx fy cx cy k"),
    ("EUCM", "eucm", "fx fy cx cy alpha beta"),
    ("EQUIRECTANGULAR", "equirectangular", "width height"),
)
LENSES = {name: (model, params.split()) for name, model, params in NAMES}
# In the order of their numbers.
BY_NUMBER = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"),
    *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"),
    *("SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR"),
)
HEAD, ONE = struct.Struct("<Q"), struct.Struct("<IiQQ")  # the count; number, model, width, height
MOST = 100_000  # cameras
MODELS = tuple(dict.fromkeys(("kannala_brandt", *(model for _, model, _ in NAMES))))
LINE = re.compile(r"^[ \t]*\d{1,18}[ \t]+[A-Z][A-Z_0-9]*[ \t]+[-+.\d]+(?:[ \t]|\r?$)", re.MULTILINE)


def matches(text: str) -> bool:
    """Say whether a line holds a number, a name in capitals and a number; or whether this is a list in COLMAP's binary.

    That has no mark of its own: a count, and the first camera's number, model and size, each within its bounds.
    """
    if not is_binary(text):
        return LINE.search(text[:1_000_000]) is not None
    head = to_bytes(text[: HEAD.size + ONE.size])
    if len(head) < HEAD.size + ONE.size:
        return False
    (count,), (_, model, width, height) = HEAD.unpack_from(head), ONE.unpack_from(head, HEAD.size)
    return 0 < count <= MOST and 0 <= model < len(BY_NUMBER) and 0 < width <= WIDEST and 0 < height <= WIDEST


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera; its name is its number."""
    if is_binary(text):
        text = "\n".join(_lines(to_bytes(text)))
    cameras: dict[str, Camera] = {}
    for i, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        words = line.split()
        try:
            camera = _camera(words)
        except ValueError as error:
            raise ValueError(f"line {i}: {error}") from error
        if words[0] in cameras:
            raise ValueError(f"line {i}: a second camera {words[0]}")
        cameras[words[0]] = camera
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the text of one camera, under the most specific of COLMAP's names."""
    refuse(camera, MODELS)
    width, height = with_size(camera)
    camera, notes = without(camera, [n for n in camera.model.param_names if n != "skew"])
    values = {**camera.model.to_dict()}
    build(camera.model.name, values)
    if camera.model.name == "equirectangular":
        name, params = "EQUIRECTANGULAR", [float(width), float(height)]
        whole = _sphere(*params)
        if any(abs(values[key] - whole[key]) > 1e-9 * width for key in whole):
            raise ValueError("EQUIRECTANGULAR is the whole sphere with forward in the middle, which this camera is not")
    else:
        name, params = _most_specific(camera.model.name, values)
    head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    text = f"{head}# Number of cameras: 1\n1 {name} {width} {height} {' '.join(map(repr, params))}\n"
    return text, notes + left_out(camera)


def _lines(data: bytes) -> list[str]:
    """Give the lines of cameras.txt of what cameras.bin holds."""
    (count,), at = HEAD.unpack_from(data), HEAD.size
    lines: list[str] = []
    for _ in range(count):
        if at + ONE.size > len(data):
            raise ValueError(f"says {count} cameras and is cut off after {len(lines)}")
        key, model, width, height = ONE.unpack_from(data, at)
        if not 0 <= model < len(BY_NUMBER):
            raise ValueError(f"no camera model of number {model}; there are 0 to {len(BY_NUMBER) - 1}")
        name, at = BY_NUMBER[model], at + ONE.size
        params = struct.Struct(f"<{len(LENSES[name][1])}d")
        if at + params.size > len(data):
            raise ValueError(f"says {count} cameras and is cut off after {len(lines)}")
        lines.append(f"{key} {name} {width} {height} {' '.join(map(repr, params.unpack_from(data, at)))}")
        at += params.size
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes more than {count} cameras have")
    return lines


def _camera(words: list[str]) -> Camera:
    if len(words) < 4:
        raise ValueError(f"expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got {' '.join(words)[:60]!r}")
    name = words[1]
    if name not in LENSES:
        raise ValueError(f"no camera model {name[:40]!r}; there are {', '.join(LENSES)}")
    model, names = LENSES[name]
    size = picture_size(_number(words[2], "width"), _number(words[3], "height"))
    if len(words) - 4 != len(names):
        raise ValueError(f"{name} has {len(names)} parameters ({', '.join(names)}), got {len(words) - 4}")
    given = {key: _number(word, key) for key, word in zip(names, words[4:], strict=True)}
    if model == "equirectangular":
        picture_size(given["width"], given["height"])
        return Camera(build(model, _sphere(given["width"], given["height"])), size)
    if "f" in given:
        given["fx"] = given["fy"] = given.pop("f")
    given["cx"] -= SHIFT
    given["cy"] -= SHIFT
    zeros = {"radial_tangential": ("k1", "k2", "p1", "p2", "k3"), "kannala_brandt": ("k1", "k2", "k3", "k4")}
    return Camera(build(model, dict.fromkeys(zeros.get(model, ()), 0.0) | given), size)


def _number(word: str, name: str) -> float:
    try:
        value: Any = float(word)
    except ValueError:
        value = word[:30]
    return number(value, name)


def _most_specific(model: str, values: Mapping[str, float]) -> tuple[str, list[float]]:
    """Give COLMAP's name with the fewest parameters that holds all that is not zero, and these."""
    shifted = {**values, "cx": values["cx"] + SHIFT, "cy": values["cy"] + SHIFT}
    one_focal = values["fx"] == values["fy"]
    for name, ours, names in NAMES:
        held = names.split()
        # FULL_OPENCV with k4, k5, k6 = 0 holds the third radial coefficient, which OPENCV lacks.
        same = ours == model or (ours == "rational" and model == "radial_tangential")
        covered = {*held, *(("fx", "fy") if "f" in held and one_focal else ())}
        if same and all(value == 0 or key in covered for key, value in values.items() if key not in ("cx", "cy")):
            return name, [shifted["fx"] if key == "f" else shifted.get(key, 0.0) for key in held]
    raise ValueError(f"cannot hold this {model} camera")


def _sphere(width: float, height: float) -> dict[str, float]:
    return {
        "fx": width / (2 * math.pi),
        "fy": height / math.pi,
        "cx": width / 2 - SHIFT,
        "cy": height / 2 - SHIFT,
    }
