"""A rolling shutter is told from a lens that the model does not describe, and from nothing."""

import numpy as np
import pytest

from lenses import BOARD, SIZE, rotation_to, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import resect
from omnisight.geometry import rotation as so3
from omnisight.quality.rolling_shutter import rolling_shutter
from omnisight.targets.observations import Observations


def rolled(model, speed, *, fov=140, noise=0.2, count=8, seed=1):
    """Shoot boards that move by so many squares while the image is read, in any direction, and turn as they do."""
    rng, middle, views = np.random.default_rng(seed), BOARD.points.mean(0), []
    for i in range(count):
        theta, phi = np.radians(fov / 2 - 38) * np.sqrt((i + 0.5) / count), 2.4 * i
        towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        lean = so3.exp([*rng.normal(0, 0.4, 2), rng.uniform(-3, 3)])
        velocity, turning = rng.normal(size=3) * speed, rng.normal(size=3) * speed / 8
        read = np.zeros(BOARD.size)
        for _ in range(8):  # when a corner is read depends on where it is seen
            turns = so3.exp(read[:, None] * turning) @ (rotation_to(towards) @ lean)
            points = np.einsum("nij,nj->ni", turns, BOARD.points - middle) + 7 * towards + read[:, None] * velocity
            pixels, valid = model.project(points)
            assert valid.all()
            read = pixels[:, 1] / SIZE[1] - 0.5
        views.append((BOARD.points, pixels + rng.normal(0, noise, pixels.shape)))
    return Observations.of(views, [f"{i}.png" for i in range(count)])


def fitted(model, views):
    return refine(resect(model, views), views).state


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_motion_while_the_rows_are_read_is_told_with_its_size_and_the_picture(speed):
    views = rolled(lens(140), speed)
    found = rolling_shutter(fitted(lens(140), views), views)
    assert found is not None
    assert found.explained > 0.6
    assert found.chance < 1e-20
    assert f"explains {found.explained:.0%} of them ({found.rms:.2f} px rms, most in {found.name})" in found.sentence
    assert found.name in views.names
    assert "hold both still, or leave out the images that moved (--drop)" in found.sentence


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_no_motion(seed):
    views = rolled(lens(140), 0.0, seed=seed)
    found = rolling_shutter(fitted(lens(140), views), views)
    assert found is not None
    assert found.sentence == ""
    assert found.chance > 1e-4
    assert found.explained < 0.15


def test_a_camera_on_its_side_reads_columns_and_is_not_taken_for_one_that_reads_rows():
    views = rolled(lens(140), 1.0)
    turned = Observations.of(
        [(views.points[g], np.stack([SIZE[1] - 1 - views.pixels[g, 1], views.pixels[g, 0]], 1)) for g in views.groups]
    )
    model = lens(140)
    centre = {"cx": SIZE[1] - 1 - model.cy, "cy": model.cx}
    aside = type(model).from_dict({**model.to_dict(), **centre})
    found = rolling_shutter(fitted(aside, turned), turned)
    assert found is not None
    assert found.sideways > 0.9
    assert found.sentence == ""


def test_a_few_corners_tell_nothing():
    views = Observations.of([(x[:8], p[:8]) for x, p in observe_boards(lens(140), 140, np.random.default_rng(0), count=3)])
    assert rolling_shutter(resect(lens(140), views), views) is None
