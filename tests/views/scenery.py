"""Cameras and a scene of smooth colours, for the tests of views."""

import numpy as np

import omnisight as om
from omnisight.camera import Camera
from omnisight.models import model_class

INTERPOLATIONS = ["nearest", "bilinear", "bicubic", "lanczos"]


def camera(name, size, **values):
    return Camera(model_class(name).from_dict(values), size)


FISHEYE = camera(
    "kannala_brandt", (400, 360), fx=118.0, fy=117.0, cx=203.2, cy=177.6, k1=0.03, k2=-0.01, k3=0.002, k4=-0.0004
)
MIRROR = camera("unified", (320, 320), fx=90.0, fy=90.0, cx=161.0, cy=158.5, xi=0.96)
SPHERE = om.sphere(256)


def colour(bearings):
    """Return three smooth channels (..., 3) in 0 to 1 of bearings (..., 3); where they are NaN, 0."""
    x, y, z = np.moveaxis(bearings, -1, 0)
    waves = np.stack([np.sin(2 * x + y - 0.3), np.cos(2 * z - x + 0.2), np.sin(y * 2 + z * x + 1)], -1)
    return np.nan_to_num(0.5 + 0.45 * waves)


def grid(size):
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).astype(float)


def image_of(of, function=colour, turn=None):
    """Evaluate a function of the bearing through a camera; `turn` is target_from_source, the function the source's."""
    bearings, _ = of.unproject(grid(of.size))
    return function(bearings if turn is None else bearings @ turn).astype(np.float32)


def spot(azimuth, elevation, width=0.05):
    """Return a bright spot in a direction (degrees: right, up)."""
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.cos(e) * np.sin(a), -np.sin(e), np.cos(e) * np.cos(a)])
    return lambda bearings: np.exp((np.nan_to_num(bearings) @ towards - 1) / width**2)


def brightest(image):
    """Return the (column, row) of the brightest pixel."""
    row, column = np.unravel_index(np.argmax(image), image.shape)
    return int(column), int(row)
