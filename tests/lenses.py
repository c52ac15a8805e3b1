"""Corners of boards through lenses and mirrors of every field of view, and calibrations from them."""

from functools import cache

import numpy as np

from omnisight.geometry import rotation as so3
from omnisight.models import model_class
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations

BOARD = Checkerboard(9, 6)
SIZE = (960, 960)
CENTRE = (481.3, 476.2)
RIM = 470.0  # px from the centre to the edge of the image's circle
NOISE = 0.2
# The length of a residual has two coordinates, each with the noise.
NOISE_RMS = NOISE * np.sqrt(2)

# Field of view (degrees), and a lens or mirror that has it; the focal length follows.
LENSES = {
    60: ("radial_tangential", {"k1": -0.12, "k2": 0.03, "p1": 1e-3, "p2": -5e-4, "k3": 0.0}),
    100: ("stereographic", {}),
    140: ("equidistant", {}),
    180: ("equisolid", {}),
    200: ("kannala_brandt", {"k1": 0.02, "k2": -0.006, "k3": 0.001, "k4": -0.0002}),
    240: ("double_sphere", {"xi": -0.2, "alpha": 0.6}),
    280: ("unified", {"xi": 0.97}),
}


def lens(fov, centre=CENTRE, **changes):
    """Give the lens of that field of view, its rim RIM px from the centre."""
    name, shape = LENSES[fov]
    half = np.radians(fov / 2)
    rim = [[np.sin(half), 0.0, np.cos(half)]]
    plain = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, **shape}
    radius = model_class(name).from_dict(plain).project(rim)[0][0, 0]
    focal = RIM / radius
    return model_class(name).from_dict({**plain, "fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1], **changes})


def facing(direction):
    """Give the shortest rotation that turns the axis to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = np.linalg.norm(axis)
    return so3.exp(axis / max(sine, 1e-12) * np.arctan2(sine, direction[2]))


def shoot(model, fov, rng, count=8, noise=NOISE, tilt=(0.35, 0.7), size=None):
    """Pose boards towards directions spread over the cone, tilted, and see their corners with noise.

    A board stays inside the cone; with a size, corners outside the image are left out.
    """
    middle = BOARD.points.mean(0)
    half = np.radians(fov / 2)
    near = (6, 12) if fov > 70 else (12, 20)
    views = []
    for i in range(count):
        while True:
            distance = rng.uniform(*near)
            theta = max(half - 0.95 * np.arctan(4.7 / distance), 0) * np.sqrt((i + 0.5) / count)
            phi = 2.4 * i + rng.uniform(-0.3, 0.3)
            towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
            about = rng.normal(size=2)
            lean = so3.exp([*(about / np.linalg.norm(about) * rng.uniform(*tilt)), 0.0])
            turn = facing(towards) @ so3.exp([0.0, 0.0, rng.uniform(-3, 3)]) @ lean
            points = (BOARD.points - middle) @ turn.T + distance * towards
            pixels, valid = model.project(points)
            if valid.all() and np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]).max() < half:
                break
        pixels = pixels + rng.normal(0, noise, pixels.shape)
        seen = np.ones(len(pixels), bool) if size is None else ((pixels > 0) & (pixels < np.array(size) - 1)).all(1)
        if seen.sum() >= 12:
            views.append((BOARD.points[seen], pixels[seen]))
    return views


def bearing_error(camera, truth, theta_max):
    """Give the largest angle (degrees) between the bearings that two cameras give a pixel, over a cone.

    The cameras may be turned against each other: a centre a little aside is a rotation, and no pose of a board knows.
    """
    theta = np.linspace(0.02, theta_max, 20)[:, None]
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    parts = np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    true = np.stack(parts, -1).reshape(-1, 3)
    pixels, _ = truth.project(true)
    found, valid = camera.unproject(pixels)
    assert valid.all()
    aligned = found @ so3.nearest(true.T @ found).T
    return float(np.degrees(np.linalg.norm(aligned - true, axis=1).max()))


@cache
def calibrated(fov, seed=0, count=8, noise=NOISE, **options):
    truth = lens(fov)
    views = shoot(truth, fov, np.random.default_rng(seed), count, noise)
    return truth, calibrate_camera(Observations.of(views), SIZE, **options)


def shown(pictures, **options):
    """Calibrate on the first images of a fisheye of 180 degrees."""
    return calibrate_camera(
        Observations.of(shoot(lens(180), 180, np.random.default_rng(0))[:pictures]), SIZE, **options
    )
