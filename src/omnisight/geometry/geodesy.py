"""Positions on the ellipsoid WGS 84 in local coordinates: east, north, up."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Semi-major axis, metres, and flattening (National Geospatial-Intelligence Agency, WGS 84, NGA.STND.0036, table 3.1).
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563
# Iterations of the latitude: each reduces the error by a factor of 150.
LATITUDE_ITERATIONS = 8


def earth_centered(positions: ArrayLike) -> Array:
    """Return Cartesian coordinates (..., 3), metres, of positions (..., 3) of latitude, longitude (degrees) and height.

    The origin is the centre of the earth, x is on the equator at longitude 0, z is the north pole (IOGP Guidance note
    7-2, sec. 4.1.1).
    """
    degrees = np.asarray(positions, float)
    latitude, longitude, height = np.radians(degrees[..., 0]), np.radians(degrees[..., 1]), degrees[..., 2]
    eccentricity2 = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR_AXIS / np.sqrt(1 - eccentricity2 * np.sin(latitude) ** 2)
    radius = (normal + height) * np.cos(latitude)
    up = (normal * (1 - eccentricity2) + height) * np.sin(latitude)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), up], axis=-1)


def east_north_up(positions: ArrayLike, origin: ArrayLike) -> Array:
    """Return coordinates (..., 3) to the east, the north and above an origin, metres.

    Parameters
    ----------
    positions
        (..., 3) latitude and longitude, degrees, and height above the ellipsoid, metres.
    origin
        (3,) of the same kind.
    """
    return (earth_centered(positions) - earth_centered(origin)) @ _local_axes(origin).T


def from_east_north_up(local: ArrayLike, origin: ArrayLike) -> Array:
    """Return latitude and longitude, degrees, and height (..., 3) of local coordinates: the inverse of `east_north_up`.

    Parameters
    ----------
    local
        (..., 3) metres to the east, the north and above the origin.
    origin
        (3,) latitude and longitude, degrees, and height above the ellipsoid, metres.
    """
    x, y, z = np.moveaxis(np.asarray(local, float) @ _local_axes(origin) + earth_centered(origin), -1, 0)
    eccentricity2 = FLATTENING * (2 - FLATTENING)
    radius = np.hypot(x, y)
    latitude = np.arctan2(z, radius * (1 - eccentricity2))
    for _ in range(LATITUDE_ITERATIONS):
        sine = np.sin(latitude)
        normal = SEMI_MAJOR_AXIS / np.sqrt(1 - eccentricity2 * sine**2)
        latitude = np.arctan2(z + eccentricity2 * normal * sine, radius)
    sine = np.sin(latitude)
    # Regular at the poles, where the radius vanishes.
    height = radius * np.cos(latitude) + z * sine - SEMI_MAJOR_AXIS * np.sqrt(1 - eccentricity2 * sine**2)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height], axis=-1)


def _local_axes(origin: ArrayLike) -> Array:
    """Return the directions east, north and up (3, 3) at a position, as rows of Cartesian coordinates."""
    latitude, longitude = np.radians(np.asarray(origin, float)[:2])
    sin, cos = np.sin([latitude, longitude]), np.cos([latitude, longitude])
    return np.array([
        [-sin[1], cos[1], 0],
        [-sin[0] * cos[1], -sin[0] * sin[1], cos[0]],
        [cos[0] * cos[1], cos[0] * sin[1], sin[0]],
    ])  # fmt: skip
