"""Positions on the ellipsoid WGS 84 in local coordinates: east, north, up."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Semi-major axis, metres, and flattening (National Geospatial-Intelligence Agency, WGS 84, NGA.STND.0036, table 3.1).
SEMI_MAJOR_AXIS, FLATTENING = 6378137.0, 1 / 298.257223563


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
    latitude, longitude = np.radians(np.asarray(origin, float)[:2])
    sin, cos = np.sin([latitude, longitude]), np.cos([latitude, longitude])
    axes = np.array([
        [-sin[1], cos[1], 0],
        [-sin[0] * cos[1], -sin[0] * sin[1], cos[0]],
        [cos[0] * cos[1], cos[0] * sin[1], sin[0]],
    ])  # fmt: skip
    return (earth_centered(positions) - earth_centered(origin)) @ axes.T
