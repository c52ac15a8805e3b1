"""Targets that are no plane: boards in one rigid body, and points anywhere, through lenses and mirrors."""

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import SIZE, lens, rotation_to
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import linear_board_poses, refine_board_poses
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3

SIDE = 5.0
FACES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))  # axes along it, and across it


def face(k):
    """Give the corners (36, 3) of a side of the cube."""
    u, v = np.meshgrid(np.linspace(0.5, SIDE - 0.5, 6), np.linspace(0.5, SIDE - 0.5, 6))
    points = np.zeros((36, 3))
    points[:, FACES[k][0]], points[:, FACES[k][1]] = u.ravel(), v.ravel()
    return points


def pose(model, fov, rng, *, inside):
    """Stand in a corner of a room with boards on its walls, or hold a cube somewhere in sight."""
    if inside:
        turn = so3.exp(rng.normal(size=3))
        return turn, -turn @ (SIDE * rng.uniform(0.25, 0.75, 3))
    theta, phi = np.radians(fov / 2) * 0.8 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    turn = rotation_to(towards) @ so3.exp(rng.normal(size=3))
    return turn, rng.uniform(7, 14) * towards - turn @ np.full(3, SIDE / 2)


def cubes(model, fov, rng, count, *, inside, noise=0.2):
    """See a cube's sides as far as they show; also the true poses."""
    views, poses = [], []
    while len(views) < count:
        turn, shift = pose(model, fov, rng, inside=inside)
        eye = -turn.T @ shift
        shown = [face(k) for k in range(3) if inside or eye[FACES[k][2]] < -0.2]
        if not shown:
            continue
        points = np.concatenate(shown)
        seen = points @ turn.T + shift
        pixels, valid = model.project(seen)
        angle = np.arctan2(np.hypot(seen[:, 0], seen[:, 1]), seen[:, 2])
        valid &= (angle < np.radians(fov / 2)) & ((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(1)
        if valid.sum() >= 12:
            views.append((points[valid], (pixels + rng.normal(0, noise, pixels.shape))[valid]))
            poses.append((turn, shift))
    return observe(views), poses


def from_truth(model, poses, views):
    """Give the rms of a start at the truth."""
    state = State(model, np.array([turn for turn, _ in poses]), np.array([shift for _, shift in poses]))
    return float(np.sqrt((refine(state, views).state.lengths(views) ** 2).mean()))


@pytest.mark.parametrize("inside", [False, True], ids=["held", "around"])
@pytest.mark.parametrize("fov", [100, 180, 280])
@pytest.mark.parametrize("count", [4, 10])
def test_a_cube_calibrates_as_from_a_start_at_the_truth(fov, inside, count):
    truth = lens(fov)
    views, poses = cubes(truth, fov, np.random.default_rng(fov + count), count, inside=inside)
    found = calibrate(views, model=truth.name)
    assert found.rms == pytest.approx(from_truth(truth, poses, views), abs=1e-4)
    assert not found.state.warp.any()
    assert "The boards tilt only" not in " ".join(found.verdict.reasons)


def test_many_wrong_corners_are_outvoted():
    truth = lens(180)
    rng = np.random.default_rng(2)
    views, _ = cubes(truth, 180, rng, 8, inside=True)
    wrong = rng.random(len(views.pixels)) < 0.1
    views.pixels[wrong] += rng.uniform(-60, 60, (wrong.sum(), 2))
    found = calibrate(views, model=truth.name)
    assert np.median(found.residual_lengths[~wrong]) < 0.3
    assert found.outliers[wrong].mean() > 0.9
    assert found.outliers[~wrong].mean() < 0.02


@pytest.mark.parametrize("shape", ["one side", "thick", "a line of boards", "cloud"])
def test_a_pose_needs_no_start(shape):
    rng = np.random.default_rng(1)
    points = {
        "one side": face(1),
        "thick": face(2) + rng.normal(0, 0.02, (36, 3)),
        "a line of boards": np.concatenate([face(0), face(0) + np.array([0, 0, 3.0]), face(0) + np.array([9.0, 0, 0])]),
        "cloud": rng.uniform(-3, 3, (20, 3)),
    }[shape]
    views, bearings, poses = [], [], []
    for _ in range(40):
        turn, shift = so3.exp(2 * rng.normal(size=3)), 12 * (towards := rng.normal(size=3)) / np.linalg.norm(towards)
        seen = points @ turn.T + shift - turn @ points.mean(0)
        bearings.append(seen / np.linalg.norm(seen, axis=1, keepdims=True) + rng.normal(0, 5e-4, seen.shape))
        views.append((points, np.zeros((len(points), 2))))
        poses.append((turn, shift - turn @ points.mean(0)))
    flat = observe(views)
    unit = np.concatenate(bearings)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    rotations, translations = refine_board_poses(flat, unit, *linear_board_poses(flat, unit))
    apart = [np.degrees(np.linalg.norm(so3.log(r @ t.T))) for r, (t, _) in zip(rotations, poses, strict=True)]
    assert np.max(apart) < 1.0
    off = [np.linalg.norm(a - b) for a, (_, b) in zip(translations, poses, strict=True)]
    assert np.max(off) < 0.3


def test_a_board_stands_on_any_plane():
    """A board told in the plane x-z is the board of the plane x-y, turned."""
    truth = lens(180)
    views, _ = cubes(truth, 180, np.random.default_rng(4), 6, inside=True)
    upright = observe([(views.points[g][:, [2, 0, 1]], views.pixels[g]) for g in views.groups])
    one, other = (calibrate(v, model=truth.name) for v in (views, upright))
    np.testing.assert_allclose(one.camera.model.params, other.camera.model.params, atol=1e-3)
    assert one.rms == pytest.approx(other.rms, abs=1e-5)
