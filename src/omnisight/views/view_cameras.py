"""Views to look at: each is a camera. Angles are in degrees here, as people say them."""

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.rotation import look
from omnisight.models.cylindrical import Cylindrical
from omnisight.models.equidistant import Equidistant
from omnisight.models.equirectangular import Equirectangular
from omnisight.models.equisolid import Equisolid
from omnisight.models.mercator import Mercator
from omnisight.models.orthographic import Orthographic
from omnisight.models.panini import Panini
from omnisight.models.pinhole import Pinhole
from omnisight.models.stereographic import Stereographic

Array = NDArray[np.float64]
Range = tuple[float, float]

WIDEST_PERSPECTIVE = 150.0
LARGEST = 32767  # px a side; what OpenCV's remap takes

CUBE_FACES = {
    "front": (0.0, 0.0),
    "right": (90.0, 0.0),
    "back": (180.0, 0.0),
    "left": (-90.0, 0.0),
    "up": (0.0, 90.0),
    "down": (0.0, -90.0),
}
FISHEYES = {
    "equidistant": Equidistant,
    "equisolid": Equisolid,
    "stereographic": Stereographic,
    "orthographic": Orthographic,
}


def perspective(fov: float = 90.0, size: tuple[int, int] = (1280, 720)) -> Camera:
    """Give a flat view, as a pinhole sees: straight lines stay straight.

    Parameters
    ----------
    fov
        Horizontal field of view, degrees, 150 at most.
    size
        (width, height), px.

    Raises
    ------
    ValueError
        If the field of view is too wide for a plane; the message names what can show it.
    """
    width, height = _size(size)
    if not 0 < fov <= WIDEST_PERSPECTIVE:
        raise ValueError(
            f"a perspective view cannot show {fov:g} degrees, {WIDEST_PERSPECTIVE:g} at most: use cylinder, panini,"
            " sphere, fisheye, or cube"
        )
    focal = width / 2 / np.tan(np.radians(fov) / 2)
    return Camera(Pinhole(focal, focal, (width - 1) / 2, (height - 1) / 2), (width, height))


def cylinder(width: int = 2048, elevation: Range = (-45.0, 45.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Give a panorama on an upright cylinder: upright lines stay straight.

    Parameters
    ----------
    width
        Of the panorama, px.
    elevation
        Lowest and highest angle above the horizon, degrees, within -89 to 89.
    azimuth
        Leftmost and rightmost angle, degrees.
    """
    model, size = _unrolled(Cylindrical, width, elevation, azimuth, limit=89.0)
    return Camera(model, size)


def mercator(width: int = 2048, elevation: Range = (-70.0, 70.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Give a panorama in Mercator's projection, which keeps shapes; as `cylinder`."""
    model, size = _unrolled(Mercator, width, elevation, azimuth, limit=89.0)
    return Camera(model, size)


def sphere(width: int = 2048, elevation: Range = (-90.0, 90.0), azimuth: Range = (-180.0, 180.0)) -> Camera:
    """Give an equirectangular image: the whole sphere unless told otherwise; as `cylinder`."""
    model, size = _unrolled(Equirectangular, width, elevation, azimuth, limit=90.0)
    return Camera(model, size)


def cube_face(size: int = 1024) -> Camera:
    """Give one face of a cube, 90 degrees wide to its outermost pixel edges; `CUBE_FACES` has (yaw, pitch) of each."""
    size, _ = _size((size, size))
    return Camera(Pinhole(size / 2, size / 2, (size - 1) / 2, (size - 1) / 2), (size, size))


def cube_rotation(face: str, view_from_source: Array) -> Array:
    """Give face_from_source (3, 3) of a named face, the cube's front being where a view looks."""
    yaw, pitch = CUBE_FACES[face]
    return look(yaw, pitch) @ view_from_source


def panini(fov: float = 150.0, size: tuple[int, int] = (1280, 720), distance: float = 1.0) -> Camera:
    """Give a Panini view: wide, upright lines straight, and little stretched at the sides.

    Parameters
    ----------
    fov
        Horizontal field of view, degrees.
    size
        (width, height), px.
    distance
        0 is a perspective, 1 the classic Panini.
    """
    width, height = _size(size)
    half = np.radians(fov) / 2
    limit = np.arccos(-distance if distance <= 1 else -1 / distance)
    if not 0 < half < limit * 0.98:
        raise ValueError(
            f"a Panini view of distance {distance:g} cannot show {fov:g} degrees,"
            f" {np.degrees(limit) * 1.96:.0f} at most"
        )
    focal = width / 2 / ((distance + 1) / (distance + np.cos(half)) * np.sin(half))
    return Camera(Panini(focal, focal, (width - 1) / 2, (height - 1) / 2, distance), (width, height))


def fisheye(size: int = 1024, fov: float = 180.0, projection: str = "equidistant") -> Camera:
    """Give an ideal fisheye image whose circle fills the square.

    Parameters
    ----------
    size
        Width and height, px.
    fov
        Field of view from rim to rim, degrees.
    projection
        "equidistant", "equisolid", "stereographic" or "orthographic".
    """
    size, _ = _size((size, size))
    if projection not in FISHEYES:
        raise ValueError(f"unknown fisheye projection {projection!r}; there are: {', '.join(FISHEYES)}")
    widest = 180.0 if projection == "orthographic" else 359.0 if projection == "stereographic" else 360.0
    if not 0 < fov <= widest:
        raise ValueError(f"an {projection} fisheye cannot show {fov:g} degrees, {widest:g} at most")
    half = np.radians(fov) / 2
    radius = {
        "equidistant": half,
        "equisolid": 2 * np.sin(half / 2),
        "stereographic": 2 * np.tan(half / 2),
        "orthographic": np.sin(half),
    }[projection]
    focal, centre = float(size / 2 / radius), (size - 1) / 2
    return Camera(FISHEYES[projection](focal, focal, centre, centre), (size, size))


def planet(size: int = 1024, fov: float = 260.0) -> Camera:
    """Give a little planet: a stereographic view, to be pointed down (pitch -90); `fov` across the image's width."""
    return fisheye(size, fov, "stereographic")


def _unrolled(
    cls: type[Cylindrical] | type[Mercator] | type[Equirectangular],
    width: int,
    elevation: Range,
    azimuth: Range,
    limit: float,
) -> tuple[Cylindrical | Mercator | Equirectangular, tuple[int, int]]:
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
        top, bottom = (float(cls.height(None, t, 1.0)) for t in down)
    height = max(1, round(focal * (bottom - top)))
    width, height = _size((width, height))
    # The outermost pixel edges lie on the angles asked for.
    fy = height / (bottom - top)
    return cls(focal, fy, -0.5 - np.radians(left) * focal, -0.5 - top * fy), (width, height)


def _size(size: tuple[int, int]) -> tuple[int, int]:
    width, height = (int(s) for s in size)
    if not (0 < width <= LARGEST and 0 < height <= LARGEST):
        raise ValueError(f"a view is 1 to {LARGEST} px a side, got {size[0]} x {size[1]}")
    return width, height
