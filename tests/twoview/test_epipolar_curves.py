"""Epipolar curves and epipoles in images of several models; the truth is the projection of points."""

import dataclasses

import numpy as np
import pytest
from scenes import unit

import omnisight as om
from every_model import EXAMPLES
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models.unified import Unified

CAMERAS = {
    "perspective": om.perspective((640, 480), 70),
    "fisheye": dataclasses.replace(om.fisheye(700, 220), theta_max=np.radians(100)),
    # A negative fx exchanges left and right, as behind a mirror.
    "mirror": om.Camera(
        Unified(-155.0, 155.0, 299.5, 299.5, xi=0.97), (600, 600), theta_min=np.radians(20), theta_max=np.radians(105)
    ),
    "cylinder": om.cylinder(1024),
    "sphere": om.sphere(1024),
}


def visible_pixels(camera, points):
    pixels, valid = camera.model.project_numpy(points)
    return pixels[valid & camera.in_image(pixels) & camera.calibrated(unit(points))]


def distance_to(polylines, pixel):
    """Return the distance of a pixel from the nearest chord."""
    start, end = (np.concatenate([piece[part] for piece in polylines]) for part in (slice(-1), slice(1, None)))
    chord = end - start
    share = ((pixel - start) * chord).sum(1) / np.maximum((chord**2).sum(1), 1e-12)
    return np.linalg.norm(start + np.clip(share, 0, 1)[:, None] * chord - pixel, axis=1).min()


def random_pose(rng):
    return om.Pose(so3.exp(rng.normal(size=3)), rng.normal(size=3))


MODELS = [pytest.param(om.Camera(*example.values, (960, 960)), id=example.id) for example in EXAMPLES]


@pytest.mark.parametrize("camera", [*(pytest.param(camera, id=name) for name, camera in CAMERAS.items()), *MODELS])
def test_points_along_a_bearing_lie_on_its_epipolar_curve(camera):
    if not isinstance(camera.model, om.CameraModel):
        pytest.skip("not central")
    rng, checked = np.random.default_rng(0), 0
    starts, valid = camera.model.unproject_numpy(rng.uniform(0.2, 0.8, (20, 2)) * camera.size)
    for seen in starts[valid]:
        pose = random_pose(rng)
        bearing = unit(pose.rotation.T @ (3 * seen - pose.translation))
        curve = om.epipolar_curve(camera, pose, bearing)
        pixels = visible_pixels(camera, pose @ (bearing * np.exp(rng.uniform(-3, 3, 40))[:, None]))
        checked += len(pixels)
        assert not len(pixels) or max(distance_to(curve, pixel) for pixel in pixels) < 0.3
    assert checked > 50


@pytest.mark.parametrize("name", CAMERAS)
def test_pieces_are_connected_and_visible(name):
    camera, rng, pieces = CAMERAS[name], np.random.default_rng(2), 0
    for _ in range(30):
        for piece in om.epipolar_curve(camera, random_pose(rng), unit(rng.normal(size=3))):
            pieces += 1
            assert camera.in_image(piece).all()
            bearings, valid = camera.model.unproject_numpy(piece)
            assert valid.all()
            low, high = camera.theta_min - 1e-6, (camera.theta_max or np.pi) + 1e-6
            angle = angle_from_axis(bearings)
            assert ((angle >= low) & (angle <= high)).all()
            # Consecutive directions are near each other: no chord crosses the image.
            assert np.linalg.norm(np.diff(bearings, axis=0), axis=1).max() < np.radians(0.3)
            assert np.linalg.norm(np.diff(piece, axis=0), axis=1).max() < max(camera.size) / 8
    assert pieces > 5


def test_a_curve_around_the_sphere_is_divided_only_at_the_seam():
    camera = CAMERAS["sphere"]
    pose = om.Pose(np.eye(3), np.array([1.0, 0.05, 0.0]))
    first, second = om.epipolar_curve(camera, pose, [0.0, 0.1, -1.0])
    assert len(om.epipolar_curve(camera, pose, [0.0, 0.1, 1.0])) == 1
    ends = sorted([first[-1], second[0]], key=lambda pixel: pixel[0])
    assert ends[0][0] == pytest.approx(-0.5, abs=1e-3)
    assert ends[1][0] == pytest.approx(1023.5, abs=1e-3)
    assert ends[0][1] == pytest.approx(ends[1][1], abs=1e-3)


def test_a_curve_through_the_pole_has_two_pieces():
    up, side = om.Pose(np.eye(3), np.array([0.0, 0.0, -1.0])), [0.0, -1.0, 0.0]
    pieces = om.epipolar_curve(CAMERAS["sphere"], up, side)
    rows = np.concatenate([piece[:, 1] for piece in pieces])
    assert rows.min() < 0.5
    assert all(np.abs(np.diff(piece[:, 0])).max() < 200 for piece in pieces)


def test_a_curve_reaches_from_epipole_to_epipole():
    camera, pose = CAMERAS["sphere"], om.Pose(so3.exp([0.2, 0.1, 0.3]), np.array([0.5, 0.2, 1.0]))
    pixels, visible = om.epipoles(camera, pose)
    assert visible.all()
    pieces = om.epipolar_curve(camera, pose, [0.3, -0.8, 0.1])
    assert pieces[0][0] == pytest.approx(pixels[0], abs=1e-6)
    assert pieces[-1][-1] == pytest.approx(pixels[1], abs=1e-6)


def test_the_first_epipole_is_the_image_of_the_other_camera():
    camera, pose = CAMERAS["fisheye"], om.Pose(so3.exp([0.2, 0.1, 0.3]), np.array([0.5, 0.2, 3.0]))
    pixels, visible = om.epipoles(camera, pose)
    assert pixels[0] == pytest.approx(camera.project(pose @ np.zeros(3))[0])
    assert visible.tolist() == [True, False]
    assert np.isnan(pixels[1]).all() or not camera.in_image(pixels[1])


def test_a_curve_does_not_enter_the_blind_spot_of_a_mirror():
    camera = CAMERAS["mirror"]
    pieces = om.epipolar_curve(camera, om.Pose(np.eye(3), np.array([1.0, 0.0, 0.3])), [0.0, 0.05, 1.0])
    assert len(pieces) == 2
    angles = np.concatenate([camera.angle_of(piece) for piece in pieces])
    assert angles.min() == pytest.approx(camera.theta_min, abs=1e-6)


def test_a_curve_outside_of_the_image_has_no_pieces():
    assert om.epipolar_curve(CAMERAS["perspective"], om.Pose(np.eye(3), np.array([1.0, 0.0, 0.0])), [0, 1, -1]) == []


def test_a_pose_without_translation_has_no_epipolar_geometry():
    with pytest.raises(ValueError, match="translation of the pose is zero"):
        om.epipolar_curve(CAMERAS["sphere"], om.Pose(), [0, 0, 1])
    with pytest.raises(ValueError, match="translation of the pose is zero"):
        om.epipoles(CAMERAS["sphere"], om.Pose())


def test_a_bearing_along_the_baseline_has_no_curve():
    with pytest.raises(ValueError, match="parallel to the baseline"):
        om.epipolar_curve(CAMERAS["sphere"], om.Pose(np.eye(3), np.array([0.0, 0.0, 2.0])), [0, 0, -1])
