"""COLMAP's cameras.txt, and cameras.bin (read only).

Lengths in px; the centre of the top-left pixel is (0.5, 0.5). The model numbers of cameras.bin are those of COLMAP's
`sensor/models.h`; forks that had EQUIRECTANGULAR earlier use 10, 16 or the name SPHERE.
"""

import re
import struct
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._export import Export, check_whole_sphere, export
from omnisight.formats._files import encode, is_binary
from omnisight.formats._limits import MAX_CAMERAS, SEARCHED_CHARS
from omnisight.formats._readers import Reader
from omnisight.formats._values import (
    HALF_PIXEL,
    MAX_SIDE_PX,
    build,
    build_with_zeros,
    image_size,
    number,
    whole_sphere,
)

TITLE = "COLMAP cameras.txt"
SUFFIX = ".txt"
CONVENTION = (
    "x right, y down, z forward; the centre of the top-left pixel is (0.5, 0.5), so cx and cy are 0.5 larger than ours"
)

# COLMAP's name, our model, our names of its parameters in its order; f is both fx and fy. Absent parameters are 0.
# Of the names of one model, the most specific comes first.
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
MODEL_NUMBERS = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"),
    *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"),
    *("SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR"),
)
COUNT, CAMERA = struct.Struct("<Q"), struct.Struct("<IiQQ")  # camera id, model number, width, height
MODELS = tuple(dict.fromkeys(("kannala_brandt", *(model for _, model, _ in NAMES))))
LINE = re.compile(r"^[ \t]*\d{1,18}[ \t]+[A-Z][A-Z_0-9]*[ \t]+[-+.\d]+(?:[ \t]|\r?$)", re.MULTILINE)
COMMENT = "# {}"
WHOLE = Reader("pycolmap 4.2")
NO_PIXEL = Reader("pycolmap 4.2", 90, "returns no pixel")
LOST_SIGN = Reader("pycolmap 4.2", 90, "projects points but unprojects pixels to the opposite direction")
READERS = dict.fromkeys(MODELS, NO_PIXEL) | {"division": LOST_SIGN, "equirectangular": WHOLE}


def matches(text: str) -> bool:
    """Return whether a line holds a number, a name in capitals and a number, or whether this is a cameras.bin.

    The binary has no signature: its count and the model number and size of its first camera must be within bounds.
    """
    if not is_binary(text):
        return LINE.search(text[:SEARCHED_CHARS]) is not None
    head = encode(text[: COUNT.size + CAMERA.size])
    if len(head) < COUNT.size + CAMERA.size:
        return False
    (count,), (_, model, width, height) = COUNT.unpack_from(head), CAMERA.unpack_from(head, COUNT.size)
    in_bounds = 0 < count <= MAX_CAMERAS and 0 <= model < len(MODEL_NUMBERS)
    return in_bounds and 0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera, named by its number."""
    if is_binary(text):
        text = "\n".join(_lines(encode(text)))
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
            raise ValueError(f"line {i}: duplicate camera {words[0]}")
        cameras[words[0]] = camera
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the text of one camera under the most specific of COLMAP's names."""
    exported, name, params = colmap_camera(camera)
    width, height = exported.size
    head = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    text = f"{head}# Number of cameras: 1\n1 {name} {width} {height} {' '.join(map(repr, params))}\n"
    return exported.result(text)


def colmap_camera(camera: Camera) -> tuple[Export, str, list[float]]:
    """Return a camera, the most specific of COLMAP's names and its parameters; raise ValueError if there is none."""
    exported = export(camera, MODELS)
    if camera.model.name == "equirectangular":
        check_whole_sphere(camera)
        return exported, "EQUIRECTANGULAR", [float(side) for side in exported.size]
    return exported, *_most_specific(camera.model.name, exported.values)


def _lines(data: bytes) -> list[str]:
    """Return the content of cameras.bin as the lines of cameras.txt."""
    (count,), at = COUNT.unpack_from(data), COUNT.size
    lines: list[str] = []
    for _ in range(count):
        if at + CAMERA.size > len(data):
            raise ValueError(f"claims {count} cameras and is cut off after {len(lines)}")
        key, model, width, height = CAMERA.unpack_from(data, at)
        if not 0 <= model < len(MODEL_NUMBERS):
            raise ValueError(f"unknown camera model {model}; known are 0 to {len(MODEL_NUMBERS) - 1}")
        name, at = MODEL_NUMBERS[model], at + CAMERA.size
        params = struct.Struct(f"<{len(LENSES[name][1])}d")
        if at + params.size > len(data):
            raise ValueError(f"claims {count} cameras and is cut off after {len(lines)}")
        lines.append(f"{key} {name} {width} {height} {' '.join(map(repr, params.unpack_from(data, at)))}")
        at += params.size
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes after the last of {count} cameras")
    return lines


def _camera(words: list[str]) -> Camera:
    """Return the camera of the words of a line."""
    if len(words) < 4:
        raise ValueError(f"expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got {' '.join(words)[:60]!r}")
    name = words[1]
    if name not in LENSES:
        raise ValueError(f"unknown camera model {name[:40]!r}; known are {', '.join(LENSES)}")
    model, names = LENSES[name]
    size = image_size(_number(words[2], "width"), _number(words[3], "height"))
    if len(words) - 4 != len(names):
        raise ValueError(f"{name} has {len(names)} parameters ({', '.join(names)}), got {len(words) - 4}")
    given = {key: _number(word, key) for key, word in zip(names, words[4:], strict=True)}
    if model == "equirectangular":
        return Camera(build(model, whole_sphere(image_size(given["width"], given["height"]))), size)
    if "f" in given:
        given["fx"] = given["fy"] = given.pop("f")
    given["cx"] -= HALF_PIXEL
    given["cy"] -= HALF_PIXEL
    return Camera(build_with_zeros(model, given), size)


def _number(word: str, name: str) -> float:
    """Return the number of a word."""
    try:
        value: Any = float(word)
    except ValueError:
        value = word[:30]
    return number(value, name)


def _most_specific(model: str, values: Mapping[str, float]) -> tuple[str, list[float]]:
    """Return COLMAP's name with the fewest parameters that holds every nonzero value, and these parameters."""
    shifted = {**values, "cx": values["cx"] + HALF_PIXEL, "cy": values["cy"] + HALF_PIXEL}
    one_focal = values["fx"] == values["fy"]
    for name, ours, names in NAMES:
        held = names.split()
        # FULL_OPENCV with k4 = k5 = k6 = 0 holds the third radial coefficient, which OPENCV lacks.
        same = ours == model or (ours == "rational" and model == "radial_tangential")
        covered = {*held, *(("fx", "fy") if "f" in held and one_focal else ())}
        if same and all(value == 0 or key in covered for key, value in values.items() if key not in ("cx", "cy")):
            return name, [shifted["fx"] if key == "f" else shifted.get(key, 0.0) for key in held]
    raise ValueError(f"cannot hold this {model} camera")
