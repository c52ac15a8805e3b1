"""omnisight epipolar, on rendered images of a room whose poses are known."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.simulation import Renderer, fisheye_setup, mirror_setup, scene_named

FISHEYE = fisheye_setup(480)
SPHERE = om.sphere(640)
B_FROM_A = om.Pose(so3.exp([0.1, 0.5, -0.2]), np.array([0.5, 0.1, 0.3]))
KEYS = [
    "matches",
    "inliers",
    "motion",
    "b_from_a",
    "alternative",
    "probability",
    "sigma_deg",
    "parallax_deg",
    "median_residual_deg",
    "seconds",
    "reason",
]


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Two 360 images, a fisheye image at the place of the first, and its camera."""
    folder, scene, world_from_a = tmp_path_factory.mktemp("room"), scene_named("room"), FISHEYE.world_from_cam
    for name, camera, pose in (
        ("a", SPHERE, world_from_a),
        ("b", SPHERE, world_from_a @ B_FROM_A.inverse()),
        ("fisheye", FISHEYE.camera, world_from_a),
    ):
        om.write_image(folder / f"{name}.png", Renderer(camera, pose, scene, samples=1)().image)
    om.save(FISHEYE.camera, folder / "fisheye.json")
    om.save(SPHERE, folder / "sphere.json")
    return folder


@pytest.fixture(scope="module")
def noise(tmp_path_factory):
    """Two images of the same camera that show nothing in common."""
    folder, rng = tmp_path_factory.mktemp("noise"), np.random.default_rng(0)
    for name in ("a", "b"):
        coarse = rng.integers(0, 256, (32, 64), np.uint8)
        om.write_image(folder / f"{name}.png", np.kron(coarse, np.ones((5, 5), np.uint8)))
    return folder


def errors_deg(result):
    """Return the errors of the rotation and of the direction."""
    pose = result["b_from_a"]
    rotation = Rotation.from_quat(pose["rotation_xyzw"]) * Rotation.from_matrix(B_FROM_A.rotation).inv()
    cosine = np.dot(pose["direction"], B_FROM_A.translation) / np.linalg.norm(B_FROM_A.translation)
    return np.degrees(rotation.magnitude()), np.degrees(np.arccos(min(cosine, 1.0)))


def failure(run, *arguments):
    """Return the JSON object and the message of images without epipolar geometry."""
    status, out, err = run("epipolar", *arguments, "--json")
    result = json.loads(out)
    assert status == 2
    assert list(result) == KEYS
    assert result["b_from_a"] is result["sigma_deg"] is result["parallax_deg"] is result["median_residual_deg"] is None
    assert result["inliers"] == 0
    assert result["motion"] in ("ambiguous", "no overlap")
    assert err.startswith("omnisight: ")
    assert result["reason"] in err
    return result["reason"]


def test_two_360_images_need_no_camera(run, photos, tmp_path):
    status, out, err = run("epipolar", photos / "a.png", photos / "b.png", "--json", "-o", tmp_path / "pair.png")
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert list(result) == KEYS
    rotation, direction = errors_deg(result)
    assert rotation < 0.2
    assert direction < 0.5
    assert 0 < rotation < 6 * result["sigma_deg"]["rotation"]
    assert 0 < direction < 6 * result["sigma_deg"]["direction"]
    assert np.linalg.norm(result["b_from_a"]["direction"]) == pytest.approx(1)
    assert 100 < result["inliers"] <= result["matches"]
    assert 2 < result["parallax_deg"] < 40
    assert 0 < result["median_residual_deg"] < 0.2
    assert result["seconds"] > 0
    assert (result["motion"], result["reason"]) == ("general", "")
    drawn = om.read_image(tmp_path / "pair.png").astype(int)
    assert drawn.shape[1] > 2000
    for half in np.array_split(drawn, 2, axis=1):
        assert ((half[..., 1] > 180) & (half[..., 0] < 100) & (half[..., 2] < 100)).sum() > 200  # inliers
        assert ((np.ptp(half, axis=2) > 150) & (half.max(2) > 200)).sum() > 2000  # curves


def test_a_rotation_has_no_direction_and_no_curves(run, photos, tmp_path):
    # Columns of a 360 image moved by an eighth of its width: the camera turned by 45 degrees.
    om.write_image(tmp_path / "turned.png", np.roll(om.read_image(photos / "a.png"), 80, axis=1))
    pair = (photos / "a.png", tmp_path / "turned.png")
    result = json.loads(run("epipolar", *pair, "-o", tmp_path / "pair.png", "--json")[1])
    assert result["motion"] == "rotation only"
    assert result["b_from_a"]["direction"] is None
    assert result["sigma_deg"]["direction"] is None
    assert np.degrees(Rotation.from_quat(result["b_from_a"]["rotation_xyzw"]).magnitude()) == pytest.approx(
        45, abs=0.05
    )
    assert result["parallax_deg"] == result["median_residual_deg"] < 0.2
    status, out, _ = run("epipolar", *pair, "-o", tmp_path / "again.png")
    assert status == 0
    assert "motion     rotation only: median parallax" in out
    assert "direction" not in out


def test_cameras_of_different_models_and_the_report(run, photos, tmp_path):
    pair, out_file = (photos / "fisheye.png", photos / "b.png"), tmp_path / "pair.jpg"
    cameras = ("--camera", photos / "fisheye.json", "--camera-b", photos / "sphere.json")
    status, out, err = run("epipolar", *pair, *cameras, "-o", out_file)
    assert (status, err) == (0, "")
    labels = [line.split()[0] for line in out.splitlines()]
    assert labels == ["matches", "motion", "parallax", "rotation", "direction", "residual", "written"]
    assert str(out_file) in out
    assert om.read_image(out_file).shape[2] == 3
    rotation, direction = errors_deg(json.loads(run("epipolar", *pair, *cameras, "--json")[1]))
    assert rotation < 0.3
    assert direction < 1


def test_keypoints_lie_in_the_mask(photos, tmp_path):
    mask = np.zeros((320, 640), np.uint8)
    mask[:, :400] = 255
    om.write_image(tmp_path / "mask.png", mask)
    result = om.epipolar(photos / "a.png", photos / "b.png", options=om.EpipolarOptions(mask=tmp_path / "mask.png"))
    assert result
    for keypoints in result.keypoints:
        assert len(keypoints) > 50
        assert keypoints.pixels[:, 0].max() < 400


def test_images_without_overlap(run, noise):
    reason = failure(run, noise / "a.png", noise / "b.png")
    assert reason.startswith("no overlap was found: ")


def test_two_motions_are_ambiguous(run, photos, tmp_path):
    image = om.read_image(photos / "a.png")  # has as many keypoints above row 170 as below
    turned = np.concatenate([np.roll(image[:170], 80, axis=1), np.roll(image[170:], -100, axis=1)])
    om.write_image(tmp_path / "turned.png", turned)
    reason = failure(run, photos / "a.png", tmp_path / "turned.png")
    assert reason.startswith("the pose is ambiguous: ")
    assert reason.endswith("structures repeat or move")


@pytest.mark.parametrize("size", [12, 16])
def test_one_object_in_two_places_lacks_matches(run, size, tmp_path):
    """The same poster hangs in two rooms: its matches agree with a pose, but nothing else matches."""
    rng = np.random.default_rng(1)
    poster = np.kron(rng.integers(0, 256, (size, size), np.uint8), np.ones((6, 6), np.uint8))
    for name, column in (("a", 60), ("b", 200)):
        image = np.kron(rng.integers(0, 256, (40, 80), np.uint8), np.ones((10, 10), np.uint8))
        image[60 : 60 + 6 * size, column : column + 6 * size] = poster
        om.write_image(tmp_path / f"{name}.png", image)
    reason = failure(run, tmp_path / "a.png", tmp_path / "b.png")
    assert reason.startswith("the pose lacks matches: from there, both images would show")


def test_identical_images(run, photos):
    assert failure(run, photos / "a.png", photos / "a.png").startswith("the images are identical")


def test_an_image_without_texture(run, photos, tmp_path):
    om.write_image(tmp_path / "wall.png", np.full((320, 640), 120, np.uint8))
    reason = failure(run, photos / "a.png", tmp_path / "wall.png")
    assert "wall.png has 0 keypoints: it shows no texture" in reason


def test_a_mask_that_excludes_everything(run, photos, tmp_path):
    om.write_image(tmp_path / "mask.png", np.zeros((320, 640), np.uint8))
    reason = failure(run, photos / "a.png", photos / "b.png", "--mask", tmp_path / "mask.png")
    assert "a.png excludes all of its pixels" in reason


def test_a_failure_writes_no_drawing(run, noise, tmp_path):
    status, out, err = run("epipolar", noise / "a.png", noise / "b.png", "-o", tmp_path / "pair.png")
    assert (status, out) == (2, "")
    assert "no overlap was found" in err
    assert not (tmp_path / "pair.png").exists()


def test_a_camera_of_another_size_is_refused(refuses, photos, tmp_path):
    pair = photos / "a.png", photos / "b.png"
    error = refuses("epipolar", *pair, "--camera", photos / "fisheye.json")
    assert "a.png: the image is 640x320, the camera 480x360" in error
    half = tmp_path / "half.json"
    om.save(SPHERE.scaled(0.5), half)
    assert "--scale-camera" in refuses("epipolar", *pair, "--camera", half)
    assert om.epipolar(*pair, half, options=om.EpipolarOptions(scale_camera=True, max_keypoints=800))


def test_only_360_images_need_no_camera(refuses, photos):
    error = refuses("epipolar", photos / "fisheye.png", photos / "b.png")
    assert "fisheye.png: is 480x360 px, and only 2:1 equirectangular images need no camera" in error


def test_invalid_files_are_refused(refuses, photos, tmp_path):
    pair = photos / "a.png", photos / "b.png"
    assert "missing.png" in refuses("epipolar", photos / "a.png", tmp_path / "missing.png")
    assert "missing.json" in refuses("epipolar", *pair, "--camera", tmp_path / "missing.json")
    om.write_image(tmp_path / "mask.png", np.full((5, 5), 255, np.uint8))
    assert "mask.png: is 5 x 5 px, and must have the size of the image or view that it masks, 640 x 320" in refuses(
        "epipolar", *pair, "--mask", tmp_path / "mask.png"
    )
    assert "there is no folder" in refuses("epipolar", *pair, "-o", tmp_path / "missing" / "pair.png")
    assert "a.png" in refuses("epipolar", *pair, "-o", photos / "a.png")
    # The output is checked before the inputs: the mask has another size.
    given = "epipolar", *pair, "--mask", tmp_path / "mask.png"
    assert "pair.gif: cannot write extension" in refuses(*given, "-o", tmp_path / "pair.gif")
    assert "--max-keypoints must be at least 1" in refuses("epipolar", *pair, "--max-keypoints", "0")


def test_a_camera_in_a_reflected_frame_is_refused_with_the_remedy(run, photos, tmp_path):
    # The calibration with a checkerboard gives the mirror a positive fx: 116 wrong matches then agree with a pose that
    # is wrong by 180 degrees.
    setup = mirror_setup(480)
    om.write_image(tmp_path / "mirror.png", setup.renderer(samples=1)().image)
    mirror = dataclasses.replace(setup.camera, theta_min=setup.theta[0], theta_max=setup.theta[1])
    om.save(om.flip_frame(mirror), tmp_path / "mirror.json")
    cameras = "--camera", photos / "fisheye.json", "--camera-b"
    images = photos / "fisheye.png", tmp_path / "mirror.png"
    reason = failure(run, *images, *cameras, tmp_path / "mirror.json")
    assert "frame of one camera is reflected" in reason
    assert "the camera of" in reason
    assert "mirror.png" in reason
    convert = "convert", tmp_path / "mirror.json", "--to", "native", "--flip", "-o", tmp_path / "flipped.json"
    assert run(*convert)[0] == 0
    status, out, _ = run("epipolar", *images, *cameras, tmp_path / "flipped.json", "--json")
    assert status == 0
    pose, truth = json.loads(out)["b_from_a"], setup.world_from_cam.inverse() @ FISHEYE.world_from_cam
    error = Rotation.from_quat(pose["rotation_xyzw"]) * Rotation.from_matrix(truth.rotation).inv()
    assert np.degrees(error.magnitude()) < 0.3
    cosine = np.dot(pose["direction"], truth.translation) / np.linalg.norm(truth.translation)
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 1


def test_a_reflected_camera_has_no_pose_of_the_imu(run, tmp_path):
    pose = [[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    extra = {"rostopic": "/cam0", "T_cam_imu": pose}
    om.save(
        om.Camera(om.model_class("unified").example(), (1000, 800), extra=extra),
        tmp_path / "chain.yaml",
        format="kalibr",
    )
    status, out, _ = run(
        "convert", tmp_path / "chain.yaml", "--to", "native", "--flip", "-o", tmp_path / "flipped.json"
    )
    assert status == 0
    assert "not written: T_cam_imu" in out
    assert om.load(tmp_path / "flipped.json").extra == {"rostopic": "/cam0"}


def test_flip_is_for_one_camera(run, tmp_path):
    om.save(om.Rig.from_sensors({name: (FISHEYE.camera, om.Pose()) for name in "ab"}), tmp_path / "rig.json")
    status, _, err = run("convert", tmp_path / "rig.json", "--to", "native", "--flip")
    assert status == 2
    assert "--flip is for one camera" in err
