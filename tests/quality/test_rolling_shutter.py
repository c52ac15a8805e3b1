"""The rolling shutter test is positive for moving boards, and negative for noise and for a rotated camera."""

import numpy as np
import pytest

from calibrating import SIZE, observe
from lenses import BOARD, lens, observe_boards, rotation_to
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import resect
from omnisight.geometry import rotation as so3
from omnisight.quality.rolling_shutter import run_rolling_shutter_test


def observe_moving_boards(model, speed, *, fov=140, noise=0.2, count=8, seed=1):
    """Observe boards that move by `speed` squares (1 sigma) in a random direction during the readout, and rotate."""
    rng, middle, views = np.random.default_rng(seed), BOARD.points.mean(0), []
    for i in range(count):
        theta, phi = np.radians(fov / 2 - 38) * np.sqrt((i + 0.5) / count), 2.4 * i
        towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        tilt = so3.exp([*rng.normal(0, 0.4, 2), rng.uniform(-3, 3)])
        velocity, angular_velocity = rng.normal(size=3) * speed, rng.normal(size=3) * speed / 8
        time = np.zeros(BOARD.size)
        for _ in range(8):  # the readout time of a corner depends on its row
            rotations = so3.exp(time[:, None] * angular_velocity) @ (rotation_to(towards) @ tilt)
            points = np.einsum("nij,nj->ni", rotations, BOARD.points - middle) + 7 * towards + time[:, None] * velocity
            pixels, valid = model.project(points)
            assert valid.all()
            time = pixels[:, 1] / SIZE[1] - 0.5
        views.append((BOARD.points, pixels + rng.normal(0, noise, pixels.shape)))
    return observe(views, names=[f"{i}.png" for i in range(count)])


def fit(model, observations):
    return refine(resect(model, observations), observations).state


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_motion_during_the_readout_is_found_with_its_size_and_image(speed):
    observations = observe_moving_boards(lens(140), speed)
    result = run_rolling_shutter_test(fit(lens(140), observations), observations)
    assert result is not None
    assert result.is_positive
    assert result.explained > 0.6
    assert result.p_value < 1e-20
    assert f"explains {result.explained:.0%} of the squared residuals" in result.sentence
    assert f"({result.rms:.2f} px rms, most in {result.name})" in result.sentence
    assert result.name in observations.names
    assert "hold board and camera still, or leave out the images with motion (--drop)" in result.sentence


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_no_motion(seed):
    observations = observe_moving_boards(lens(140), 0.0, seed=seed)
    result = run_rolling_shutter_test(fit(lens(140), observations), observations)
    assert result is not None
    assert not result.is_positive
    assert result.sentence == ""
    assert result.p_value > 1e-4
    assert result.explained < 0.15


def test_readout_of_columns_is_not_taken_for_that_of_rows():
    upright = observe_moving_boards(lens(140), 1.0)
    rotated = observe(
        [
            (upright.points[g], np.stack([SIZE[1] - 1 - upright.pixels[g, 1], upright.pixels[g, 0]], 1))
            for g in upright.groups
        ]
    )
    model = lens(140)
    centre = {"cx": SIZE[1] - 1 - model.cy, "cy": model.cx}
    model = type(model).from_dict({**model.to_dict(), **centre})
    result = run_rolling_shutter_test(fit(model, rotated), rotated)
    assert result is not None
    assert result.explained_by_columns > 0.9
    assert result.sentence == ""


def test_too_few_corners_per_view_give_no_result():
    views = observe_boards(lens(140), 140, np.random.default_rng(0), count=3)
    few = observe([(x[::7], p[::7]) for x, p in views])
    assert run_rolling_shutter_test(resect(lens(140), few), few) is None
