"""Resection of a known object from pixels of any camera."""

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.models import model_class, model_names
from omnisight.optics.models.axial import Axial

OBJECT = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 3))
LENS = model_class("kannala_brandt")(250.0, 250.0, 319.5, 239.5, 0.02, -0.01, 0.0, 0.0)
CAMERA = om.Camera(LENS, (640, 480))
AXIAL = om.RayCamera(Axial(LENS, (0.03, 0.01)), (640, 480))


def pose(rng):
    return om.Pose(so3.exp(rng.normal(size=3)), np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(1.2, 2.0)]))


def observe(camera, pose, rng, sigma):
    pixels, valid = camera.project(pose @ OBJECT)
    assert valid.all()
    return pixels + rng.normal(0, sigma, pixels.shape)


def step(found, truth):
    """Return the step (w, v) from the true pose to the estimate."""
    turn = so3.log(found.rotation @ truth.rotation.T)
    return np.concatenate([turn, found.translation - truth.translation])


@pytest.mark.parametrize("camera", [CAMERA, AXIAL], ids=["central", "axial"])
def test_the_covariance_is_that_of_the_errors(camera):
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(60):
        truth = pose(rng)
        found = om.resect(OBJECT, observe(camera, truth, rng, 0.3), 0.09 * np.eye(2), camera=camera)
        error = step(found.cam_from_world, truth)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # The mean of 60 chi-square variables of 6 degrees of freedom is within 6 +- 1.2 in 99 of 100 cases.
    assert np.mean(squares) == pytest.approx(6, abs=1.3)


@pytest.mark.parametrize("camera", [CAMERA, AXIAL], ids=["central", "axial"])
def test_exact_pixels_give_the_exact_pose_despite_outliers(camera):
    rng = np.random.default_rng(2)
    truth = pose(rng)
    pixels = observe(camera, truth, rng, 0.0)
    pixels[:12] += rng.uniform(20, 80, (12, 2))
    found = om.resect(OBJECT, pixels, 0.01 * np.eye(2), camera=camera)
    assert not found.inliers[:12].any()
    assert found.inliers[12:].all()
    np.testing.assert_allclose(step(found.cam_from_world, truth), 0, atol=1e-5)


def test_a_central_camera_in_place_of_an_axial_one_is_wrong():
    rng = np.random.default_rng(3)
    truth = pose(rng)
    pixels = observe(AXIAL, truth, rng, 0.0)
    central, axial = (om.resect(OBJECT, pixels, 0.25 * np.eye(2), camera=c) for c in (CAMERA, AXIAL))
    errors = [np.linalg.norm(step(found.cam_from_world, truth)[3:]) for found in (central, axial)]
    assert errors[1] < 1e-5 < 1e-3 < errors[0]


def test_the_noise_of_the_pixels_is_estimated():
    rng = np.random.default_rng(4)
    truth = pose(rng)
    pixels = observe(CAMERA, truth, rng, 0.5)
    known, unknown = (om.resect(OBJECT, pixels, cov, camera=CAMERA) for cov in (0.25 * np.eye(2), None))
    assert unknown.sigma_deg == pytest.approx(known.sigma_deg, rel=0.3)
    assert known.sigma_deg == pytest.approx(np.degrees(0.5 / 250), rel=0.2)


@pytest.mark.parametrize("name", model_names())
def test_every_model_gives_the_pose(name):
    camera = om.Camera(model_class(name).example(), (960, 960))
    rng = np.random.default_rng(5)
    bearings, _ = camera.samples(count=8)
    truth = pose(rng)
    points = truth.inverse() @ (bearings * rng.uniform(1, 3, (len(bearings), 1)))
    found = om.resect(points, camera.project(truth @ points)[0], 0.01 * np.eye(2), camera=camera)
    np.testing.assert_allclose(step(found.cam_from_world, truth), 0, atol=1e-5)


def test_pixels_outside_the_domain_are_outliers():
    rng = np.random.default_rng(6)
    truth = pose(rng)
    pixels = observe(CAMERA, truth, rng, 0.1)
    pixels[3] = np.nan
    found = om.resect(OBJECT, pixels, camera=CAMERA)
    assert found
    assert not found.inliers[3]
    assert found.inliers.sum() >= 38


def test_too_few_points_are_a_result_with_a_reason():
    found = om.resect(OBJECT[:2], np.full((2, 2), 100.0), camera=CAMERA)
    assert not found
    assert found.reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((OBJECT, np.zeros((40, 3))), "needs points"),
        ((OBJECT * np.nan, np.zeros((40, 2))), r"points\[0\] is not finite"),
        ((OBJECT, np.zeros((40, 2)), np.eye(3)), "must be"),
        ((OBJECT, np.zeros((40, 2)), -np.eye(2)), "positive definite"),
        ((OBJECT, np.zeros((40, 2)), None, 0.1), "sigma_deg is for bearings"),
    ],
)
def test_wrong_arrays_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        om.resect(*arguments, camera=CAMERA)


def test_a_rig_is_refused_with_the_names_of_its_cameras():
    rig = om.Rig.from_sensors({"left": (CAMERA, om.Pose()), "right": (CAMERA, om.Pose())})
    with pytest.raises(ValueError, match=r"a rig of 2 cameras \(left, right\): pass one of them"):
        om.resect(OBJECT, np.zeros((40, 2)), camera=rig)
    image = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    with pytest.raises(ValueError, match="pass one of them"):
        om.epipolar(image, image, rig)


def test_the_camera_may_be_a_file(tmp_path):
    om.save(CAMERA, tmp_path / "camera.json")
    pixels, _ = CAMERA.project(OBJECT + np.array([0.0, 0.0, 3.0]))
    known = om.resect(OBJECT, pixels, 0.01 * np.eye(2), camera=CAMERA).cam_from_world.matrix
    for file in (tmp_path / "camera.json", str(tmp_path / "camera.json")):
        found = om.resect(OBJECT, pixels, 0.01 * np.eye(2), camera=file)
        np.testing.assert_allclose(found.cam_from_world.matrix, known, atol=1e-9)
