"""Bird's-eye views of a rendered car, against the texture of the ground and OpenCV."""

import dataclasses

import cv2
import numpy as np
import pytest

import omnisight as om
import rendered_car as car
from omnisight.calibration.ground_calibration import GroundMarks, calibrate_ground, ground_position, on_ground
from omnisight.geometry.rotation import exp, log
from omnisight.optics.models.axial import Axial
from omnisight.pipeline.birdseye.ground_board import rig_on_plane
from omnisight.pipeline.birdseye.ground_rig import GroundFile, calibrate_to_marks
from omnisight.simulation.example_rigs import surround_car
from omnisight.views.ground_view import Bowl, GroundView
from omnisight.views.seam_weights import seam_weights

OPTIONS = om.BirdseyeOptions(pixel="2cm", margin="2m", gain=False)


@pytest.fixture(scope="module")
def result():
    return om.birdseye(car.images(), car.RIG, OPTIONS)


def moved(rig, degrees=0.7, metres=0.02, seed=2):
    """Return the rig with disturbed poses."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal((len(rig), 6)) * ([np.radians(degrees)] * 3 + [metres] * 3)
    poses = [pose.moved(step) for pose, step in zip(rig.sensor_from_rig, steps, strict=True)]
    return dataclasses.replace(rig, sensor_from_rig=tuple(poses))


def true_marks(rig, count=40, noise=0.0):
    """Return exact pixels of random points of the ground that each camera sees."""
    rng, marks = np.random.default_rng(5), {}
    ground = rng.uniform(-5, 5, (40 * count, 2))
    pixels, _ = rig.project(on_ground(ground))
    for name, seen, at in zip(rig.names, rig.in_view(on_ground(ground)), pixels, strict=True):
        marks[name] = GroundMarks(at[seen][:count] + noise * rng.standard_normal((count, 2)), ground[seen][:count])
    return marks


def test_the_view_equals_the_texture_of_the_ground(result):
    truth, seen = car.texture_at(result.renderer.view), result.renderer.remapper.covered
    assert seen.mean() > 0.7
    # The renderer's light and exposure are one factor per level; compare after a straight-line fit.
    image = result.image[seen].astype(float)
    slope, offset = np.polyfit(image.ravel(), truth[seen].ravel(), 1)
    error = slope * image + offset - truth[seen]
    assert 10 * np.log10(255**2 / np.mean(error**2)) > 28


def test_a_shifted_view_does_not_equal_the_texture(result):
    truth, seen = car.texture_at(result.renderer.view), result.renderer.remapper.covered
    assert np.corrcoef(np.roll(result.image, 10, 1)[seen].ravel(), truth[seen].ravel())[0, 1] < 0.8


def test_the_maps_equal_those_of_opencv(result):
    view = result.renderer.view
    camera, pose = car.RIG.cameras[0], car.RIG.sensor_from_rig[0]
    m = camera.model
    k, d = np.array([[m.fx, 0, m.cx], [0, m.fy, m.cy], [0, 0, 1]]), np.array([m.k1, m.k2, m.k3, m.k4])
    seen = result.renderer.remapper.maps[0]
    points = view.points()[seen.visible]
    rotation, _ = cv2.Rodrigues(pose.rotation)
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], rotation, pose.translation, k, d)
    ahead = (pose @ points)[:, 2] > 0.05  # OpenCV mirrors points behind the camera
    assert ahead.sum() > 1000
    np.testing.assert_allclose(seen.pixels[seen.visible][ahead], theirs[:, 0][ahead], atol=1e-3)


def test_the_vehicle_is_black_and_hides_the_ground_behind_it(result):
    view = result.renderer.view
    u, v = np.rint(view.pixels([0.0, 0.0])).astype(int)
    assert not result.image[v, u].any()
    front = result.renderer.remapper.maps[0].visible
    behind = view.ground(np.stack(np.meshgrid(*map(np.arange, view.size)), -1))[..., 1] < 2.0
    assert front.any()
    assert not (front & behind).any()


def test_weights_sum_to_one_and_are_continuous():
    resolution = [np.full((20, 60), 2.0, np.float32), np.full((20, 60), 1.0, np.float32)]
    left = np.zeros((20, 60), bool)
    left[:, :40] = True
    weights = seam_weights(resolution, [left, np.ones((20, 60), bool)], feather_px=10)
    np.testing.assert_allclose(weights.sum(0), 1, atol=1e-6)
    assert weights[0][10, 20] == 1
    assert weights[0][10, 50] == 0
    assert np.abs(np.diff(weights[0][10])).max() <= 0.25


def test_gains_equalize_images_of_different_exposure():
    images = dict(car.images())
    images["left"] = (images["left"] * 0.8).astype(np.uint8)
    plain = om.birdseye(images, car.RIG, OPTIONS)
    equal = om.birdseye(images, car.RIG, dataclasses.replace(OPTIONS, gain=True))
    assert equal.seam_step < 0.5 * plain.seam_step


def test_a_bowl_is_flat_near_the_vehicle_and_rises_beyond():
    bowl = Bowl((2.0, 3.0), 4.0)
    assert bowl.height([1.9, -2.9]) == 0
    assert bowl.height([6.0, 0.0]) == pytest.approx(2.0)
    step = (bowl.height([6.001, 0.0]) - bowl.height([6.0, 0.0])) / 0.001
    assert step == pytest.approx(1.0, abs=1e-3)
    flat, bent = (
        om.birdseye(car.images(), car.RIG, dataclasses.replace(OPTIONS, bowl=bowl_at)) for bowl_at in (None, "1m")
    )
    rows = slice(0, 20)  # far in front, where the bowl rises
    assert np.abs(flat.image[rows].astype(int) - bent.image[rows]).mean() > 5


def test_pixels_and_positions_of_a_view_are_inverse():
    view = GroundView(0.02, (-3, 4, -5, 6))
    assert view.size == (350, 550)
    np.testing.assert_allclose(view.ground(view.pixels([[1.0, 2.0], [-3.0, 6.0]])), [[1.0, 2.0], [-3.0, 6.0]])
    np.testing.assert_allclose(view.ground([0, 0]), [-2.99, 5.99])


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_marks_determine_the_poses(noise):
    found = calibrate_ground(moved(car.RIG, 20, 1.0), true_marks(car.RIG, noise=noise))
    assert found
    for k, name in enumerate(car.RIG.names):
        true, pose = car.RIG.sensor_from_rig[k], found.rig.sensor_from_rig[k]
        error = np.concatenate([log(pose.rotation @ true.rotation.T), pose.translation - true.translation])
        if noise == 0:
            assert np.abs(error).max() < 1e-6
            continue
        block = found.rig.covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        # 1e-4 of chi-squared with six degrees of freedom.
        assert error @ np.linalg.solve(block, error) < 27.9
        assert found.fits[name].height == pytest.approx(
            -true.inverse().translation[1], abs=4 * found.fits[name].sigma_height
        )


def test_outlier_marks_are_rejected():
    marks = true_marks(car.RIG, noise=0.2)
    marks["left"].pixels[:5] += 40
    found = calibrate_ground(car.RIG, marks)
    assert not found.fits["left"].inliers[:5].any()
    assert found.fits["left"].inliers[5:].mean() > 0.9
    assert found.fits["left"].rms_px < 0.5


def test_the_corners_of_a_layout_calibrate_a_disturbed_rig():
    images = [car.images("squares")[name] for name in car.RIG.names]
    start = moved(car.RIG)
    found = calibrate_to_marks(start, images, GroundFile({}, car.LAYOUT))
    assert found
    for k, name in enumerate(car.RIG.names):
        true, pose = car.RIG.sensor_from_rig[k], found.rig.sensor_from_rig[k]
        assert len(found.marks[name]) > 20
        assert found.fits[name].rms_px < 0.2
        assert np.linalg.norm(pose.inverse().translation - true.inverse().translation) < 0.01


def test_rays_meet_the_ground_where_it_was_projected():
    marks = true_marks(car.RIG)
    for name in car.RIG.names:
        at, valid = ground_position(car.RIG, name, marks[name].pixels)
        assert valid.all()
        np.testing.assert_allclose(at, marks[name].ground, atol=1e-6)


def test_a_board_on_the_ground_determines_its_plane():
    turn = om.Pose(exp([0.05, 0.0, -0.03]), np.array([0.1, -0.4, 0.2]))  # rig from ground
    rig = dataclasses.replace(car.RIG, sensor_from_rig=tuple(pose @ turn.inverse() for pose in car.RIG.sensor_from_rig))
    x, y = np.meshgrid(np.arange(6) * 0.1, np.arange(5) * 0.1)
    board = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    # The board's x is right, its y backward, its z down.
    points = np.stack([board[:, 0] - 0.2, 0 * x.ravel(), 4.0 - board[:, 1]], -1)
    pixels, valid = rig.cameras[0].project(rig.sensor_from_rig[0] @ (turn @ points))
    assert valid.all()
    found = rig_on_plane(rig, "front", board, pixels)
    assert found
    for true, pose in zip(car.RIG.sensor_from_rig, found.rig.sensor_from_rig, strict=True):
        assert pose.inverse().translation[1] == pytest.approx(true.inverse().translation[1], abs=1e-5)


def test_rays_of_a_non_central_camera_meet_the_ground_at_the_pixels_of_the_view():
    camera = om.RayCamera(Axial.example(), (960, 962), theta_max=1.2)
    rig = om.Rig.from_sensors({"down": (camera, om.Pose(om.look(pitch=-90.0)) @ om.Pose(translation=[0, 1.5, 0]))})
    image = np.full((962, 960, 3), 100, np.uint8)
    options = dataclasses.replace(OPTIONS, pixel="5cm", vehicle="none")
    renderer = om.birdseye([image], rig, options).renderer
    seen = renderer.remapper.maps[0]
    assert seen.visible.sum() > 1000
    at, valid = ground_position(rig, "down", seen.pixels[seen.visible])
    assert valid.all()
    expected = renderer.view.points()[seen.visible][:, [0, 2]]
    np.testing.assert_allclose(at, expected, atol=2e-3)


def test_a_rig_at_a_height_gives_the_same_view_as_a_rig_on_the_ground():
    rig = surround_car(240)
    at_height = dataclasses.replace(
        rig, sensor_from_rig=tuple(p @ om.Pose(translation=np.array([0, -1.2, 0])) for p in rig.sensor_from_rig)
    )
    images = {name: cv2.resize(image, rig.cameras[0].size) for name, image in car.images().items()}
    options = dataclasses.replace(OPTIONS, pixel="5cm")
    expected = om.birdseye(images, rig, options)
    found = om.birdseye(images, at_height, dataclasses.replace(options, height="1.2m"))
    np.testing.assert_allclose(found.image.astype(int), expected.image.astype(int), atol=1)


def test_messages():
    images = car.images()
    with pytest.raises(ValueError, match=r"3 images for the 4 cameras"):
        om.birdseye(list(images.values())[:3], car.RIG, OPTIONS)
    with pytest.raises(ValueError, match=r"one image\s+for each camera"):
        om.birdseye({**images, "roof": images["left"]}, car.RIG, OPTIONS)
    with pytest.raises(ValueError, match=r"left: the image is 240x180"):
        om.birdseye({**images, "left": images["left"][::2, ::2]}, car.RIG, OPTIONS)
    high = dataclasses.replace(
        car.RIG, sensor_from_rig=tuple(p @ om.Pose(translation=np.array([0, -2.0, 0])) for p in car.RIG.sensor_from_rig)
    )
    with pytest.raises(ValueError, match=r"height of the rig is unknown"):
        om.birdseye(images, high, OPTIONS)
    with pytest.raises(ValueError, match=r"upside down or too low"):
        om.birdseye(images, high, dataclasses.replace(OPTIONS, height="20cm"))
    with pytest.raises(ValueError, match=r"specify one of"):
        om.BirdseyeOptions(height="1m", ground="marks.json")
    up = om.Pose(om.look(pitch=110.0))
    poses = (up @ car.RIG.sensor_from_rig[0], *car.RIG.sensor_from_rig[1:])
    with pytest.raises(ValueError, match=r"front sees none of the ground"):
        om.birdseye(
            images, dataclasses.replace(car.RIG, sensor_from_rig=poses), dataclasses.replace(OPTIONS, margin="1m")
        )
