"""Targets that are not planar: boards on one rigid body, and points anywhere on it."""

import numpy as np
import pytest

from calibrating import SIZE, calibrate, observe
from lenses import lens, rotation_to
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import linear_board_poses, refine_board_poses
from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis

SIDE = 5.0
# The two axes along each face of a cube, and the one across it.
FACES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


def face(k):
    """Return the corners (36, 3) on a face of the cube."""
    u, v = np.meshgrid(np.linspace(0.5, SIDE - 0.5, 6), np.linspace(0.5, SIDE - 0.5, 6))
    points = np.zeros((36, 3))
    points[:, FACES[k][0]], points[:, FACES[k][1]] = u.ravel(), v.ravel()
    return points


def random_pose(fov, rng, *, inside):
    """Return cam_from_cube of a camera inside the cube, or of a cube in front of the camera."""
    if inside:
        rotation = so3.exp(rng.normal(size=3))
        return rotation, -rotation @ (SIDE * rng.uniform(0.25, 0.75, 3))
    theta, phi = np.radians(fov / 2) * 0.8 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
    towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    rotation = rotation_to(towards) @ so3.exp(rng.normal(size=3))
    return rotation, rng.uniform(7, 14) * towards - rotation @ np.full(3, SIDE / 2)


def observe_cubes(model, fov, rng, count, *, inside, noise=0.2):
    """Return observations of the visible faces of a cube, and the true poses."""
    views, poses = [], []
    while len(views) < count:
        rotation, translation = random_pose(fov, rng, inside=inside)
        camera = -rotation.T @ translation
        visible = [face(k) for k in range(3) if inside or camera[FACES[k][2]] < -0.2]
        if not visible:
            continue
        points = np.concatenate(visible)
        in_camera = points @ rotation.T + translation
        pixels, valid = model.project(in_camera)
        angle = angle_from_axis(in_camera)
        valid &= (angle < np.radians(fov / 2)) & ((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(1)
        if valid.sum() >= 12:
            views.append((points[valid], (pixels + rng.normal(0, noise, pixels.shape))[valid]))
            poses.append((rotation, translation))
    return observe(views), poses


def rms_from_truth(model, poses, views):
    """Return the rms of a refinement that starts at the truth."""
    state = State(
        model, np.array([rotation for rotation, _ in poses]), np.array([translation for _, translation in poses])
    )
    return float(np.sqrt((refine(state, views).state.lengths(views) ** 2).mean()))


@pytest.mark.parametrize("inside", [False, True], ids=["outside", "inside"])
@pytest.mark.parametrize("fov", [100, 180, 280])
@pytest.mark.parametrize("count", [4, 10])
def test_calibration_from_a_cube_reaches_the_optimum_near_the_truth(fov, inside, count):
    truth = lens(fov)
    views, poses = observe_cubes(truth, fov, np.random.default_rng(fov + count), count, inside=inside)
    calibration = calibrate(views, model=truth.name)
    assert calibration.rms == pytest.approx(rms_from_truth(truth, poses, views), abs=1e-4)
    assert not calibration.state.warp.any()
    assert "The boards are tilted by only" not in " ".join(calibration.reasons)


def test_outliers_on_a_cube_are_identified():
    truth = lens(180)
    rng = np.random.default_rng(2)
    views, _ = observe_cubes(truth, 180, rng, 8, inside=True)
    outliers = rng.random(len(views.pixels)) < 0.1
    views.pixels[outliers] += rng.uniform(-60, 60, (outliers.sum(), 2))
    calibration = calibrate(views, model=truth.name)
    assert np.median(calibration.residual_lengths[~outliers]) < 0.3
    assert calibration.outliers[outliers].mean() > 0.9
    assert calibration.outliers[~outliers].mean() < 0.02


@pytest.mark.parametrize("shape", ["one side", "thick", "a line of boards", "cloud"])
def test_pose_is_resected_without_a_start(shape):
    rng = np.random.default_rng(1)
    points = {
        "one side": face(1),
        "thick": face(2) + rng.normal(0, 0.02, (36, 3)),
        "a line of boards": np.concatenate([face(0), face(0) + np.array([0, 0, 3.0]), face(0) + np.array([9.0, 0, 0])]),
        "cloud": rng.uniform(-3, 3, (20, 3)),
    }[shape]
    views, bearings, poses, placeholder = [], [], [], np.random.default_rng(2).uniform(0, 900, (len(points), 2))
    for _ in range(40):
        rotation, translation = (
            so3.exp(2 * rng.normal(size=3)),
            12 * (towards := rng.normal(size=3)) / np.linalg.norm(towards),
        )
        in_camera = points @ rotation.T + translation - rotation @ points.mean(0)
        bearings.append(
            in_camera / np.linalg.norm(in_camera, axis=1, keepdims=True) + rng.normal(0, 5e-4, in_camera.shape)
        )
        views.append((points, placeholder))  # the bearings determine the pose
        poses.append((rotation, translation - rotation @ points.mean(0)))
    flat = observe(views)
    unit = np.concatenate(bearings)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    rotations, translations = refine_board_poses(flat, unit, *linear_board_poses(flat, unit))
    apart = [np.degrees(np.linalg.norm(so3.log(r @ t.T))) for r, (t, _) in zip(rotations, poses, strict=True)]
    assert np.max(apart) < 1.0
    off = [np.linalg.norm(a - b) for a, (_, b) in zip(translations, poses, strict=True)]
    assert np.max(off) < 0.3


def test_board_may_lie_in_any_plane():
    """Permuted coordinates of the target give the same camera."""
    truth = lens(180)
    views, _ = observe_cubes(truth, 180, np.random.default_rng(4), 6, inside=True)
    upright = observe([(views.points[g][:, [2, 0, 1]], views.pixels[g]) for g in views.groups])
    one, other = (calibrate(v, model=truth.name) for v in (views, upright))
    np.testing.assert_allclose(one.camera.model.params, other.camera.model.params, atol=1e-3)
    assert one.rms == pytest.approx(other.rms, abs=1e-5)
