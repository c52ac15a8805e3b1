"""Simulated corners of boards for lenses and mirrors of every field of view, and calibrations from them."""

from functools import cache

import numpy as np

from calibrating import calibrate, observe
from omnisight.geometry import rotation as so3
from omnisight.models import model_class
from omnisight.targets import Checkerboard

BOARD = Checkerboard(9, 6)
CENTRE = (481.3, 476.2)
RIM = 470.0  # radius of the image circle, px
NOISE = 0.2  # of each coordinate (1 sigma), px
# The length of a residual combines two coordinates.
NOISE_RMS = NOISE * np.sqrt(2)

# Field of view (degrees) and the model of a lens or mirror that has it; `lens` computes the focal length.
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
    """Return the lens of a field of view (degrees) whose image circle has the radius RIM."""
    name, shape = LENSES[fov]
    half = np.radians(fov / 2)
    rim = np.array([[np.sin(half), 0.0, np.cos(half)]])
    plain = {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0, **shape}
    radius = model_class(name).from_dict(plain).project_numpy(rim)[0][0, 0]  # compiles nothing
    focal = RIM / radius
    return model_class(name).from_dict({**plain, "fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1], **changes})


def rotation_to(direction):
    """Return the smallest rotation that turns the optical axis to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    sine = np.linalg.norm(axis)
    return so3.exp(axis / max(sine, 1e-12) * np.arctan2(sine, direction[2]))


def observe_boards(model, fov, rng, count=8, noise=NOISE, tilt=(0.35, 0.7), size=None):
    """Return the board points and the noisy pixels of tilted boards spread over the field of view.

    Every board lies inside the field of view (degrees). With an image size, corners outside the image are removed.
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
            turn = rotation_to(towards) @ so3.exp([0.0, 0.0, rng.uniform(-3, 3)]) @ lean
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
    """Return the largest angle (degrees) between the bearings of two cameras for the same pixels, up to `theta_max`.

    The best rotation between the cameras is removed: the poses of the boards absorb it.
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
def calibrate_lens(fov, seed=0, count=8, noise=NOISE, **options):
    """Return the true model and its calibration; every result is computed once per process."""
    truth = lens(fov)
    views = observe_boards(truth, fov, np.random.default_rng(seed), count, noise)
    return truth, calibrate(observe(views), **options)


def calibrate_first_views(count, **options):
    """Calibrate a fisheye of 180 degrees with its first views."""
    views = observe_boards(lens(180), 180, np.random.default_rng(0))[:count]
    return calibrate(observe(views), **options)
