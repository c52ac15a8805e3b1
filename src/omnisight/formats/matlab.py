"""MATLAB's fisheyeIntrinsics: a line of MATLAB, its json (jsonencode), a struct in a .mat; OCamCalib's .mat too.

MappingCoefficients are a0 a2 a3 a4, WITHOUT a1, with z forward (a0 > 0), in px^(1-i). ImageSize is rows, columns but
DistortionCenter is x, y, and counts pixels from ONE: the centre of the top-left pixel is (1, 1). StretchMatrix [c d; e
1] acts on x, y: inverse(StretchMatrix) (points - DistortionCenter) is the sensor's point, as a user found by comparing
with undistortFisheyePoints (mathworks.com, answers 1750125). OCamCalib's `ocam_model` in a .mat has a0 < 0, all of a0
a1 a2 ..., xc the ROW and yc the column, both from one, and a stretch of row, column.

A .mat is read by a small reader of our own (`_matlab_file`); a fisheyeIntrinsics object in it is code, and refused. So
is the object `calib_data` of OCamCalib, version 3. Written is the line that makes the object in MATLAB.
"""

import json
import re
from collections.abc import Mapping
from typing import Any, cast

from omnisight.camera import Camera
from omnisight.formats._binary import is_binary, to_bytes
from omnisight.formats._checks import left_out, number, numbers, picture_size, refuse, with_size
from omnisight.formats._matlab_file import NO_HDF5, read_mat
from omnisight.formats._protocol import note_unknown
from omnisight.formats._scaramuzza import model_of, model_of_xy, of_degree_four, xy_of_model
from omnisight.formats._yaml import read_map, scalar
from omnisight.models.ocam import Ocam

TITLE = "MATLAB fisheyeIntrinsics"
SUFFIX = ".m"
MODELS = ("ocam",)
CONVENTION = "z forward; no a1; centre as x, y from ONE; size as rows, columns; stretch [c d; e 1] on x, y"
FIRST = 1.0  # of the top-left pixel
NAMES = ("MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix")
CALL = re.compile(r"\bfisheyeIntrinsics[ \t]*\(([^()]{1,2000})\)")
MATRIX = re.compile(r"\[([^\[\]]*)\]")
KEY = re.compile(r'"MappingCoefficients"\s*:')
OCAM = ("ss", "xc", "yc", "c", "d", "e", "width", "height")
TOOLBOX = "calib_data"
OF_TOOLBOX = (
    f"{TOOLBOX} is an object of OCamCalib, which is code: take out its numbers; in MATLAB, with the toolbox on its path"
    f" and this file loaded: ocam_model = {TOOLBOX}.ocam_model; save('ocam.mat', 'ocam_model', '-v7')"
)
HELP = (
    "i = {}.Intrinsics; s = struct('MappingCoefficients', i.MappingCoefficients, 'ImageSize', i.ImageSize,"
    " 'DistortionCenter', i.DistortionCenter, 'StretchMatrix', i.StretchMatrix); save('s.mat', 's', '-v7')"
)


def matches(text: str) -> bool:
    """Say whether there is a call of fisheyeIntrinsics, its properties as json, or a .mat."""
    if is_binary(text):
        return text.startswith(("MATLAB ", "\x89HDF"))
    return CALL.search(text[:1_000_000]) is not None or (text.lstrip().startswith("{") and KEY.search(text) is not None)


def parse(text: str) -> Mapping[str, Camera]:
    """Read every camera."""
    if is_binary(text):
        return _mat(text)
    if text.lstrip().startswith("{"):
        data = read_map(text)
        return {"camera": _camera(data["Intrinsics"] if isinstance(data.get("Intrinsics"), dict) else data)}
    calls = [MATRIX.findall(found) for found in CALL.findall(text[:1_000_000])]
    cameras: dict[str, Camera] = {}
    for i, matrices in enumerate(calls):
        if not 3 <= len(matrices) <= 4:
            raise ValueError(f"fisheyeIntrinsics takes 3 or 4 matrices, got {len(matrices)}")
        rows = [[[scalar(w) for w in re.split(r"[\s,]+", row.strip())] for row in m.split(";")] for m in matrices]
        flat = [row[0] for row in rows[:3]]
        fields: dict[str, Any] = dict(zip(NAMES, [*flat, *rows[3:]], strict=False))
        cameras["camera" if len(calls) == 1 else f"camera{i + 1}"] = _camera(fields)
    return cameras


def render(camera: Camera) -> tuple[str, tuple[str, ...]]:
    """Give the line of MATLAB."""
    refuse(camera, MODELS, "convert it with --model ocam")
    width, height = with_size(camera)
    camera, notes = of_degree_four(camera)
    model = cast(Ocam, camera.model)
    direct, c, d, e = xy_of_model(model)
    model_of_xy(direct, cx=model.cx, cy=model.cy, c=c, d=d, e=e)
    a = " ".join(repr(value) for value in (direct[0], *direct[2:]))
    centre = f"{model.cx + FIRST!r} {model.cy + FIRST!r}"
    text = (
        "% MappingCoefficients a0 a2 a3 a4, ImageSize rows columns, DistortionCenter x y from 1, StretchMatrix on x y\n"
        f"intrinsics = fisheyeIntrinsics([{a}], [{height} {width}], [{centre}], [{c!r} {d!r}; {e!r} 1]);\n"
    )
    return text, notes + left_out(camera)


def _mat(text: str) -> Mapping[str, Camera]:
    if not text.startswith("MATLAB 5.0 "):
        raise ValueError(NO_HDF5)
    cameras: dict[str, Camera] = {}
    held = read_mat(to_bytes(text))
    if TOOLBOX in held and held[TOOLBOX] is None:
        raise ValueError(OF_TOOLBOX)
    structs = [(name, value) for name, value in held.items() if isinstance(value, dict)]
    inside = [(name, value.get(part)) for name, value in structs for part in ("Intrinsics", "ocam_model")]
    for name, fields in (("camera", held), *structs, *inside):
        if isinstance(fields, dict) and "MappingCoefficients" in fields:
            cameras[name] = _camera(fields, columns=True)
        elif isinstance(fields, dict) and set(OCAM) <= set(fields):
            cameras[name] = _ocam_model(fields)
    if not cameras:
        objects = [name[:60] for name, value in held.items() if value is None and name.isidentifier()]
        said = f"{objects[0]} is no struct of numbers" if objects else "no fisheye in it"
        raise ValueError(
            f"{said}; in MATLAB, with this file loaded: {HELP.format(objects[0] if objects else 'params')}"
        )
    return cameras


def _camera(fields: Mapping[str, Any], *, columns: bool = False) -> Camera:
    if missing := [name for name in NAMES[:3] if fields.get(name) is None]:
        raise ValueError(f"{', '.join(missing)} missing")
    a = numbers(fields["MappingCoefficients"], NAMES[0], 4)
    rows, width = numbers(fields["ImageSize"], NAMES[1], 2)
    centre = numbers(fields["DistortionCenter"], NAMES[2], 2)
    stretch = fields.get("StretchMatrix") or [[1.0, 0.0], [0.0, 1.0]]
    if columns and len(stretch) == 4:  # a .mat runs down the columns
        stretch = [stretch[0::2], stretch[1::2]]
    if not isinstance(stretch, list) or len(stretch) != 2:
        raise ValueError(f"StretchMatrix must be 2 x 2, got {str(stretch)[:60]}")
    (c, d), (e, one) = (numbers(row, NAMES[3], 2) for row in stretch)
    if abs(one - 1) > 1e-9:
        raise ValueError(f"StretchMatrix must be [c d; e 1], got {one:g} in place of 1")
    model = model_of_xy([a[0], 0.0, *a[1:]], cx=centre[0] - FIRST, cy=centre[1] - FIRST, c=c, d=d, e=e)
    return Camera(model, picture_size(width, rows), extra=_plain(note_unknown(fields, set(NAMES))))


def _ocam_model(fields: Mapping[str, Any]) -> Camera:
    direct = numbers(fields["ss"], "ss")
    v = {name: number((fields[name] or [None])[0], name) for name in OCAM if name != "ss"}
    plane = {"cx": v["yc"] - FIRST, "cy": v["xc"] - FIRST, "c": v["c"], "d": v["d"], "e": v["e"]}
    size = picture_size(v["width"], v["height"])
    return Camera(model_of([-value for value in direct], **plane), size)


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Give what json can hold."""
    return {key: value for key, value in values.items() if json.dumps(value, default=str)}
