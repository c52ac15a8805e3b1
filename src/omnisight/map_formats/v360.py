"""Options of FFmpeg's filter `v360`, for ideal cameras."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.map_formats._protocol import MapFiles
from omnisight.map_formats._table import RemapTable, with_suffix

Array = NDArray[np.float64]

TITLE = "FFmpeg's v360 filter"
PROGRAMS = ()
CONVENTION = "v360 places pixel centres up to 0.55 px elsewhere (99 %, FFmpeg 5.1); --to ffmpeg is exact"
INTERPOLATION = {"nearest": "near", "bilinear": "line", "bicubic": "cubic", "lanczos": "lanc"}
# Largest distance (px) of the image centre from the principal point, and error of the size of a whole sphere.
MAX_OFFSET_PX = 0.01
# Share of the view that may be missing, because v360 shows only the ellipse inscribed in the image of a fisheye.
MAX_MISSING_FRACTION = 0.001
MAX_FOV_DEG = 360.0 + 1e-6
REMEDY = "use --to ffmpeg"


class Projection(NamedTuple):
    """A projection of v360.

    Attributes
    ----------
    name
        Its name.
    horizontal_fov, vertical_fov
        The field of view (radians) of an image whose half width or height is x focal lengths; NaN if there is none.
    """

    name: str
    horizontal_fov: Callable[[float], float]
    vertical_fov: Callable[[float], float]


def _arcsine(x: float) -> float:
    return math.asin(x) if x <= 1 else math.nan


def _radial(name: str, fov: Callable[[float], float]) -> Projection:
    return Projection(name, fov, fov)


PROJECTIONS = {
    "pinhole": _radial("flat", lambda x: 2 * math.atan(x)),
    "equidistant": _radial("fisheye", lambda x: 2 * x),
    "stereographic": _radial("sg", lambda x: 4 * math.atan(x / 2)),
    "equisolid": _radial("equisolid", lambda x: 4 * _arcsine(x / 2)),
    "orthographic": _radial("og", lambda x: 2 * _arcsine(x)),
    "cylindrical": Projection("cylindrical", lambda x: 2 * x, lambda x: 2 * math.atan(x)),
}


def convert(table: RemapTable, output: Path) -> MapFiles:
    """Return the filter as a text file, and the command."""
    file = with_suffix(output, (".txt",))
    rotation, *others = table.rotations
    if others:
        raise ValueError(f"v360 has no cross of six faces: {REMEDY}")
    _check_circle(table)
    options = {
        "input": _projection(table.source, "i", "the camera"),
        "output": _projection(table.target, "", "the view"),
        "direction": _direction(rotation.T),
        "size": f"w={table.target.width}:h={table.target.height}:interp={INTERPOLATION[table.interpolation]}",
    }
    text = f"v360=input={options['input']}:output={options['output']}:{options['direction']}:{options['size']}"
    return MapFiles(((file, (text + "\n").encode()),), f"ffmpeg -i INPUT -vf '{text}' OUTPUT")


def _projection(camera: Camera, prefix: str, role: str) -> str:
    """Return the name and the field of view of a projection; refuse a camera that has none in v360."""
    model, (width, height) = camera.model, camera.size
    cx, cy = camera.project([0.0, 0.0, 1.0])[0].tolist()
    offset = math.hypot(cx - (width - 1) / 2, cy - (height - 1) / 2)
    if model.name not in (*PROJECTIONS, "equirectangular"):
        names = ", ".join([*PROJECTIONS, "equirectangular"])
        raise ValueError(f"v360 has no projection for {role}, a {model.name}; it has {names}: {REMEDY}")
    if offset > MAX_OFFSET_PX:
        raise ValueError(
            f"v360 needs {role} to have its axis in the image centre, and it is {offset:.2f} px beside: {REMEDY}"
        )
    values = model.to_dict()
    x, y = width / 2 / values["fx"], height / 2 / values["fy"]
    if model.name == "equirectangular":
        if max(abs(x - math.pi) * values["fx"], abs(y - math.pi / 2) * values["fy"]) > MAX_OFFSET_PX:
            raise ValueError(f"v360 needs {role} to be a whole sphere (equirectangular 2:1): {REMEDY}")
        return "e"
    name, horizontal, vertical = PROJECTIONS[model.name]
    fov = math.degrees(horizontal(x)), math.degrees(vertical(y))
    if not max(fov) <= MAX_FOV_DEG:
        raise ValueError(f"v360 needs {role} to have a field of view of at most 360 degrees at all edges: {REMEDY}")
    return f"{name}:{prefix}h_fov={fov[0]:.9g}:{prefix}v_fov={fov[1]:.9g}"


def _direction(source_from_view: Array) -> str:
    """Return yaw, pitch, roll (degrees) and the flip of a rotation or reflection (3, 3)."""
    flip = np.linalg.det(source_from_view) < 0
    r = np.diag([-1.0, 1.0, 1.0]) @ source_from_view if flip else source_from_view
    cosine = math.hypot(r[1, 0], r[1, 1])
    pitch = math.atan2(-r[1, 2], cosine)
    if cosine > 1e-9:
        yaw, roll = math.atan2(r[0, 2], r[2, 2]), math.atan2(r[1, 0], r[1, 1])
    else:  # straight up or down, yaw and roll have the same axis
        yaw, roll = math.atan2(-r[2, 0], r[0, 0]), 0.0
    angles = (f"{name}={math.degrees(a):.9g}" for name, a in (("yaw", yaw), ("pitch", pitch), ("roll", roll)))
    return ":".join(angles) + (":h_flip=1" if flip else "")


def _check_circle(table: RemapTable) -> None:
    """Refuse a view of the corners of a fisheye image, which v360 leaves blank."""
    if table.source.model.name != "equidistant":
        return
    width, height = table.source.size
    u, v = (np.where(table.covered, values, 0.0) for values in (table.u, table.v))
    outside = np.hypot((u + 0.5) / width - 0.5, (v + 0.5) / height - 0.5) > 0.5
    missing = float((outside & table.covered).sum() / table.covered.sum())
    if missing > MAX_MISSING_FRACTION:
        raise ValueError(
            f"v360 shows only the ellipse inscribed in the image of a fisheye, which lacks {missing:.1%} of the view:"
            f" {REMEDY}"
        )
