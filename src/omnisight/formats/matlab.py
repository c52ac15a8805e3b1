"""MATLAB's fisheyeIntrinsics: a line of MATLAB, its json (jsonencode), a struct in a .mat; also OCamCalib's .mat.

MappingCoefficients are a0 a2 a3 a4, WITHOUT a1, with z forward (a0 > 0), in px^(1-i). ImageSize is rows, columns but
DistortionCenter is x, y, and counts pixels from ONE: the centre of the top-left pixel is (1, 1). StretchMatrix [c d; e
1] acts on x, y: inverse(StretchMatrix) (points - DistortionCenter) is the point on the sensor, as a comparison with
undistortFisheyePoints shows (mathworks.com, answers 1750125). OCamCalib's `ocam_model` in a .mat has a0 < 0, all of a0
a1 a2 ..., xc the ROW and yc the column, both from one, and a stretch on row, column.

A fisheyeIntrinsics object in a .mat is code, and refused; so is OCamCalib's object `calib_data`, version 3. The file
that is written is the line that creates the object in MATLAB.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from omnisight.camera import Camera
from omnisight.formats._detect import is_json_with
from omnisight.formats._export import unknown_fields
from omnisight.formats._files import encode, is_binary
from omnisight.formats._limits import SEARCHED_CHARS
from omnisight.formats._mat import HDF5_ERROR, HDF5_SIGNATURES, SIGNATURE, read_mat
from omnisight.formats._readers import Reader
from omnisight.formats._scaramuzza import export_xy, model_of, model_of_xy
from omnisight.formats._values import FIRST_PIXEL, image_size, number, numbers
from omnisight.formats._yaml import read_map, scalar

TITLE = "MATLAB fisheyeIntrinsics"
SUFFIX = ".m"
MODELS = ("ocam",)
CONVENTION = "z forward; no a1; centre as x, y from ONE; size as rows, columns; stretch [c d; e 1] on x, y"
NAMES = ("MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix")
CALL = re.compile(r"\bfisheyeIntrinsics[ \t]*\(([^()]{1,2000})\)")
MATRIX = re.compile(r"\[([^\[\]]*)\]")
OCAM_FIELDS = ("ss", "xc", "yc", "c", "d", "e", "width", "height")
TOOLBOX = "calib_data"
TOOLBOX_ERROR = (
    f"{TOOLBOX} is an object of OCamCalib, which is code: extract its numbers; in MATLAB, with the toolbox on its path"
    f" and this file loaded: ocam_model = {TOOLBOX}.ocam_model; save('ocam.mat', 'ocam_model', '-v7')"
)
EXTRACT_COMMAND = (
    "i = {}.Intrinsics; s = struct('MappingCoefficients', i.MappingCoefficients, 'ImageSize', i.ImageSize,"
    " 'DistortionCenter', i.DistortionCenter, 'StretchMatrix', i.StretchMatrix); save('s.mat', 's', '-v7')"
)
COMMENT = "% {}"
READERS: Mapping[str, Reader] = {}  # not measured


def matches(text: str) -> bool:
    """Return whether this is a call of fisheyeIntrinsics, its properties as json, or a .mat."""
    if is_binary(text):
        return text.startswith((SIGNATURE, *HDF5_SIGNATURES))
    return CALL.search(text[:SEARCHED_CHARS]) is not None or is_json_with(text, "MappingCoefficients")


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    if is_binary(text):
        return _mat(text)
    if text.lstrip().startswith("{"):
        data = read_map(text)
        return {"camera": _camera(data["Intrinsics"] if isinstance(data.get("Intrinsics"), dict) else data)}
    calls = [MATRIX.findall(arguments) for arguments in CALL.findall(text[:SEARCHED_CHARS])]
    cameras: dict[str, Camera] = {}
    for i, matrices in enumerate(calls):
        if not 3 <= len(matrices) <= 4:
            raise ValueError(f"fisheyeIntrinsics takes 3 or 4 matrices, got {len(matrices)}")
        rows = [[[scalar(w) for w in re.split(r"[\s,]+", row.strip())] for row in m.split(";")] for m in matrices]
        flat = [row[0] for row in rows[:3]]
        fields: dict[str, Any] = dict(zip(NAMES, [*flat, *rows[3:]], strict=False))
        cameras["camera" if len(calls) == 1 else f"camera{i + 1}"] = _camera(fields)
    return cameras


def serialize(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Return the line of MATLAB."""
    exported = export_xy(camera, max_terms=0)
    (width, height), direct, plane = exported.size, exported.direct, exported.plane
    a = " ".join(repr(value) for value in (direct[0], *direct[2:]))
    centre = f"{plane['cx'] + FIRST_PIXEL!r} {plane['cy'] + FIRST_PIXEL!r}"
    c, d, e = plane["c"], plane["d"], plane["e"]
    text = (
        "% MappingCoefficients a0 a2 a3 a4, ImageSize rows columns, DistortionCenter x y from 1, StretchMatrix on x y\n"
        f"intrinsics = fisheyeIntrinsics([{a}], [{height} {width}], [{centre}], [{c!r} {d!r}; {e!r} 1]);\n"
    )
    return exported.result(text)


def _mat(text: str) -> Mapping[str, Camera]:
    """Read every camera of a .mat."""
    if not text.startswith(SIGNATURE):
        raise ValueError(HDF5_ERROR)
    cameras: dict[str, Camera] = {}
    variables = read_mat(encode(text))
    if TOOLBOX in variables and variables[TOOLBOX] is None:
        raise ValueError(TOOLBOX_ERROR)
    structs = [(name, value) for name, value in variables.items() if isinstance(value, dict)]
    nested = [(name, value.get(part)) for name, value in structs for part in ("Intrinsics", "ocam_model")]
    for name, fields in (("camera", variables), *structs, *nested):
        if isinstance(fields, dict) and "MappingCoefficients" in fields:
            cameras[name] = _camera(fields, columns=True)
        elif isinstance(fields, dict) and set(OCAM_FIELDS) <= set(fields):
            cameras[name] = _ocam_model(fields)
    if not cameras:
        objects = [name[:60] for name, value in variables.items() if value is None and name.isidentifier()]
        reason = f"{objects[0]} is not a struct of numbers" if objects else "no fisheye in the file"
        command = EXTRACT_COMMAND.format(objects[0] if objects else "params")
        raise ValueError(f"{reason}; in MATLAB, with this file loaded: {command}")
    return cameras


def _camera(fields: Mapping[str, Any], *, columns: bool = False) -> Camera:
    """Return the camera of the properties of fisheyeIntrinsics."""
    if missing := [name for name in NAMES[:3] if fields.get(name) is None]:
        raise ValueError(f"{', '.join(missing)} missing")
    a = numbers(fields["MappingCoefficients"], NAMES[0], 4)
    rows, width = numbers(fields["ImageSize"], NAMES[1], 2)
    centre = numbers(fields["DistortionCenter"], NAMES[2], 2)
    stretch = fields.get("StretchMatrix") or [[1.0, 0.0], [0.0, 1.0]]
    if columns and len(stretch) == 4:  # column-major in a .mat
        stretch = [stretch[0::2], stretch[1::2]]
    if not isinstance(stretch, list) or len(stretch) != 2:
        raise ValueError(f"StretchMatrix must be 2 x 2, got {str(stretch)[:60]}")
    (c, d), (e, one) = (numbers(row, NAMES[3], 2) for row in stretch)
    if abs(one - 1) > 1e-9:
        raise ValueError(f"StretchMatrix must be [c d; e 1], got {one:g} in place of 1")
    model = model_of_xy([a[0], 0.0, *a[1:]], cx=centre[0] - FIRST_PIXEL, cy=centre[1] - FIRST_PIXEL, c=c, d=d, e=e)
    return Camera(model, image_size(width, rows), extra=_plain(unknown_fields(fields, set(NAMES))))


def _ocam_model(fields: Mapping[str, Any]) -> Camera:
    """Return the camera of OCamCalib's `ocam_model`."""
    direct = numbers(fields["ss"], "ss")
    v = {name: number((fields[name] or [None])[0], name) for name in OCAM_FIELDS if name != "ss"}
    plane = {"cx": v["yc"] - FIRST_PIXEL, "cy": v["xc"] - FIRST_PIXEL, "c": v["c"], "d": v["d"], "e": v["e"]}
    size = image_size(v["width"], v["height"])
    return Camera(model_of([-value for value in direct], **plane), size)


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that json can hold."""
    return {key: value for key, value in values.items() if json.dumps(value, default=str)}
