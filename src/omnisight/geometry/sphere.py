"""Directions on the sphere: angles from the axis, azimuths, uniform samples."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def angle_from_axis(directions: Array) -> Array:
    """Return the angle (...), radians, between directions (..., 3) of any length and the z axis."""
    return np.arctan2(np.hypot(directions[..., 0], directions[..., 1]), directions[..., 2])


def angle_between(a: Array, b: Array) -> Array:
    """Return the angles (...), radians, between unit vectors (..., 3)."""
    return 2 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def polar(theta: Array, phi: Array) -> Array:
    """Return the bearings (..., 3) at angles from the axis and azimuths, radians; azimuth 0 is x, pi/2 is y."""
    s = np.sin(theta)
    return np.stack([s * np.cos(phi), s * np.sin(phi), np.cos(theta)], -1)


def tangent(start: Array, end: Array) -> Array:
    """Return the tangent (3,) at a unit vector along the great circle to another; its length is the angle."""
    across = end - (start @ end) * start
    length = float(np.linalg.norm(across))
    factor = float(np.arctan2(length, start @ end)) / length if length > 0 else 0.0
    return np.asarray(factor * across, float)


def cap(reach: float, rings: int) -> Array:
    """Return nearly uniformly distributed bearings (N, 3) up to an angle from the axis (radians)."""
    thetas = reach * (np.arange(rings) + 0.5) / rings
    counts = np.maximum(np.round(2 * np.pi * np.sin(thetas) / (reach / rings)), 3).astype(int)
    return np.concatenate(
        [polar(np.full(n, t), 2 * np.pi * (np.arange(n) + 0.5) / n) for t, n in zip(thetas, counts, strict=True)]
    )
