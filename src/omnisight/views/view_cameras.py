"""Cameras for common views: perspective, panoramas, fisheye, cube. Angles are in degrees."""

from typing import Literal

import numpy as np

from omnisight.camera import Camera
from omnisight.extensions import unknown_name
from omnisight.models.cylindrical import Cylindrical
from omnisight.models.equidistant import Equidistant
from omnisight.models.equirectangular import Equirectangular
from omnisight.models.equisolid import Equisolid
from omnisight.models.mercator import Mercator
from omnisight.models.orthographic import Orthographic
from omnisight.models.panini import Panini
from omnisight.models.pinhole import Pinhole
from omnisight.models.stereographic import Stereographic

Range = tuple[float, float]
Size = int | tuple[int, int]
FisheyeProjection = Literal["equidistant", "equisolid", "stereographic", "orthographic"]

# A wider perspective view is stretched beyond use at its sides.
MAX_PERSPECTIVE_FOV_DEG = 150.0
# Limit of OpenCV's remap (16-bit coordinates).
MAX_SIDE_PX = 32767

FISHEYE_MODELS = {
    "equidistant": Equidistant,
    "equisolid": Equisolid,
    "stereographic": Stereographic,
    "orthographic": Orthographic,
}


def perspective(size: Size = (1280, 720), fov: float = 90.0) -> Camera:
    """Return a pinhole camera: straight lines stay straight.

    Parameters
    ----------
    size
        (width, height), px; one number for a square.
    fov
        Horizontal field of view, degrees, at most 150.

    Raises
    ------
    ValueError
        If the field of view is too wide; the message lists alternatives.
    """
    width, height = _checked_size(size, fov, "perspective")
    if not 0 < fov <= MAX_PERSPECTIVE_FOV_DEG:
        raise ValueError(
            f"a perspective view cannot show {fov:g} degrees, only up to {MAX_PERSPECTIVE_FOV_DEG:g}: use cylinder,"
            " panini, sphere, fisheye or cube"
        )
    focal = width / 2 / np.tan(np.radians(fov) / 2)
    return Camera(Pinhole(focal, focal, (width - 1) / 2, (height - 1) / 2), (width, height))


def cylinder(width: int = 2048, elevation: Range = (-45.0, 45.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Return a panorama on a vertical cylinder: vertical lines stay straight.

    Parameters
    ----------
    width
        Width of the panorama, px; the height follows.
    elevation
        Lowest and highest elevation, degrees, within -89 to 89.
    azimuth
        Leftmost and rightmost azimuth, degrees, within -180 to 180.

    Raises
    ------
    ValueError
        If a range is empty or outside its limits.
    """
    model, size = _unrolled(Cylindrical, width, elevation, azimuth, limit=89.0)
    return Camera(model, size)


def mercator(width: int = 2048, elevation: Range = (-70.0, 70.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Return a panorama in the Mercator projection, which is conformal; parameters as in `cylinder`."""
    model, size = _unrolled(Mercator, width, elevation, azimuth, limit=89.0)
    return Camera(model, size)


def sphere(width: int = 2048, elevation: Range = (-90.0, 90.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Return an equirectangular camera, by default of the whole sphere; parameters as in `cylinder`."""
    model, size = _unrolled(Equirectangular, width, elevation, azimuth, limit=90.0)
    return Camera(model, size)


def cube_face(size: int = 1024) -> Camera:
    """Return one face of a cube map: 90 degrees between the outer edges of the outer pixels."""
    size, _ = _checked_size((size, size))
    return Camera(Pinhole(size / 2, size / 2, (size - 1) / 2, (size - 1) / 2), (size, size))


def panini(size: Size = (1280, 720), fov: float = 150.0, distance: float = 1.0) -> Camera:
    """Return a Panini view: wide, with straight vertical lines and little stretching at the sides.

    Parameters
    ----------
    size
        (width, height), px; one number for a square.
    fov
        Horizontal field of view, degrees.
    distance
        0 is the perspective projection, 1 the classic Panini projection.

    Raises
    ------
    ValueError
        If the field of view is too wide for the distance.
    """
    width, height = _checked_size(size, fov, "panini")
    half = np.radians(fov) / 2
    limit = np.arccos(-distance if distance <= 1 else -1 / distance)
    if not 0 < half < limit * 0.98:
        raise ValueError(
            f"a Panini view of distance {distance:g} cannot show {fov:g} degrees, only up to"
            f" {np.degrees(limit) * 1.96:.0f}"
        )
    focal = width / 2 / ((distance + 1) / (distance + np.cos(half)) * np.sin(half))
    return Camera(Panini(focal, focal, (width - 1) / 2, (height - 1) / 2, distance), (width, height))


def fisheye(size: Size = 1024, fov: float = 180.0, projection: FisheyeProjection = "equidistant") -> Camera:
    """Return an ideal fisheye camera whose image circle has the diameter of the shorter side.

    Parameters
    ----------
    size
        (width, height), px; one number for a square.
    fov
        Field of view across the image circle, degrees.
    projection
        "equidistant", "equisolid", "stereographic" or "orthographic".

    Raises
    ------
    ValueError
        If the projection is unknown or cannot show the field of view.
    """
    width, height = _checked_size(size, fov, "fisheye")
    if projection not in FISHEYE_MODELS:
        raise ValueError(unknown_name("fisheye projection", projection, FISHEYE_MODELS))
    widest = 180.0 if projection == "orthographic" else 359.0 if projection == "stereographic" else 360.0
    if not 0 < fov <= widest:
        raise ValueError(f"an {projection} fisheye cannot show {fov:g} degrees, only up to {widest:g}")
    half = np.radians(fov) / 2
    radius = {
        "equidistant": half,
        "equisolid": 2 * np.sin(half / 2),
        "stereographic": 2 * np.tan(half / 2),
        "orthographic": np.sin(half),
    }[projection]
    focal = float(min(width, height) / 2 / radius)
    return Camera(FISHEYE_MODELS[projection](focal, focal, (width - 1) / 2, (height - 1) / 2), (width, height))


def planet(size: Size = 1024, fov: float = 260.0) -> Camera:
    """Return a "little planet" camera: a stereographic fisheye to be pointed down (pitch -90)."""
    return fisheye(size, fov, "stereographic")


def _unrolled(
    cls: type[Cylindrical] | type[Mercator] | type[Equirectangular],
    width: int,
    elevation: Range,
    azimuth: Range,
    limit: float,
) -> tuple[Cylindrical | Mercator | Equirectangular, tuple[int, int]]:
    """Return the model and the size of a panorama with square pixels on the horizon."""
    low, high = elevation
    left, right = azimuth
    if not -limit <= low < high <= limit:
        raise ValueError(f"elevation must be (low, high) within -{limit:g} to {limit:g} degrees, got {elevation}")
    if not (-180 <= left < right <= 180):
        raise ValueError(f"azimuth must be (left, right) within -180 to 180 degrees, got {azimuth}")
    focal = width / np.radians(right - left)
    down = np.tan(np.radians(-np.clip(np.array([high, low]), -89.999999999, 89.999999999)))
    if limit == 90:
        top, bottom = -np.radians(high), -np.radians(low)
    else:
        top, bottom = (float(cls.cylinder_height(None, t, 1.0)) for t in down)
    height = max(1, round(focal * (bottom - top)))
    width, height = _checked_size((width, height))
    # The outer edges of the outer pixels are at the limits of the ranges.
    fy = height / (bottom - top)
    return cls(focal, fy, -0.5 - np.radians(left) * focal, -0.5 - top * fy), (width, height)


def _checked_size(size: Size, fov: float = 0.0, view: str = "") -> tuple[int, int]:
    """Return (width, height) of a size in px; raise ValueError if it is none, or the angle is not one number."""
    if np.ndim(fov) or isinstance(fov, str):
        raise ValueError(f"fov must be one angle in degrees, got {fov!r}: the order is {view}(size, fov)")
    try:
        width, height = (int(s) for s in np.broadcast_to(size, 2))
    except (TypeError, ValueError):
        raise ValueError(f"size must be (width, height) in px, or one number for a square, got {size!r}") from None
    if not (0 < width <= MAX_SIDE_PX and 0 < height <= MAX_SIDE_PX):
        raise ValueError(f"width and height of a view must be from 1 to {MAX_SIDE_PX} px, got {width} x {height}")
    return width, height
