"""omnisight stereo, on rendered images of a room whose distances are known."""

import dataclasses
import json

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.pipeline.two_views.stereo_files import write_distances
from omnisight.simulation import Renderer, fisheye_setup, scene_named

SETUP = fisheye_setup(440)
RIGHT_FROM_LEFT = om.Pose(so3.exp([0.02, -0.03, 0.05]), np.array([-0.2, 0.01, 0.02]))
CAMERA = om.Camera(SETUP.camera.model, SETUP.camera.size, theta_max=SETUP.theta[1])
KEYS = [
    *(
        "unit",
        "baseline",
        "rectified_size",
        "max_disparity",
        "min_distance",
        "matches",
        "inliers",
        "row_difference",
        "rotation_from_rig_deg",
    ),
    *("share", "distance", "relative_sigma", "steps", "seconds", "warnings", "reason"),
]


def rig_of(pose, **others):
    return om.Rig.from_sensors({"left": (CAMERA, om.Pose()), "right": (CAMERA, pose), **others})


@pytest.fixture(scope="module")
def scene():
    """Return the folder of a stereo pair and its rigs, and the true distances of the left image."""
    return scene_named("room")


@pytest.fixture(scope="module")
def pair(tmp_path_factory, scene):
    folder, world_from_left = tmp_path_factory.mktemp("pair"), SETUP.world_from_cam
    poses = {"left": world_from_left, "right": world_from_left @ RIGHT_FROM_LEFT.inverse()}
    for name, pose in poses.items():
        renderer = Renderer(CAMERA, pose, scene, samples=1, theta=SETUP.theta)
        om.write_image(folder / f"{name}.png", renderer().image)
        np.save(folder / f"{name}.npy", renderer.truth().depth)
    om.save(rig_of(RIGHT_FROM_LEFT), folder / "rig.json")
    return folder


@pytest.fixture(scope="module")
def result(pair):
    return om.stereo(pair / "left.png", pair / "right.png", pair / "rig.json")


def arguments(pair, rig="rig.json"):
    return "stereo", pair / "left.png", pair / "right.png", "--rig", pair / rig


def failure(run, *given):
    """Return the reason of a pair without distances."""
    status, out, err = run(*given, "--json")
    data = json.loads(out)
    assert status == 2
    assert list(data) == KEYS
    assert data["share"] == 0
    assert data["distance"] is data["relative_sigma"] is None
    assert data["reason"] in err
    return data["reason"]


def test_distances_agree_with_the_scene(result, pair):
    truth = np.load(pair / "left.npy")
    known = np.isfinite(result.distance)
    assert result
    assert result.share > 0.7
    assert result.distance.shape == truth.shape
    assert np.isfinite(truth[known]).all()
    assert np.median(np.abs(result.distance[known] / truth[known] - 1)) < 0.03
    assert result.check.inliers > 100
    assert result.check.row_px < 0.3
    assert 0 < result.check.rotation_deg < 4 * result.check.rotation_sigma_deg < 0.4
    assert result.check.warning == ""
    np.testing.assert_allclose(result.right_from_left.translation, RIGHT_FROM_LEFT.translation, atol=1e-12)


def test_the_points_are_those_of_the_scene_in_the_left_frame(result, pair, scene):
    points, colors = result.points()
    assert len(points) == len(colors) == np.isfinite(result.distance).sum()
    pixels, valid = CAMERA.project(points)
    assert valid.all()
    u, v = np.rint(pixels).astype(int).T
    np.testing.assert_array_equal(colors, om.read_image(pair / "left.png")[v, u])
    in_world = SETUP.world_from_cam @ points[::100]
    distance = np.linalg.norm(in_world - SETUP.world_from_cam.translation, axis=1)
    directions = (in_world - SETUP.world_from_cam.translation) / distance[:, None]
    expected = scene.cast(SETUP.world_from_cam.translation, directions).distances
    assert np.median(np.abs(distance / expected - 1)) < 0.03


def test_points_of_images_of_16_bits_have_colors(result):
    left = result.photos[0]
    deep = dataclasses.replace(
        result, photos=(left._replace(image=left.image.astype(np.uint16) * 257), result.photos[1])
    )
    np.testing.assert_array_equal(deep.points()[1], result.points()[1])


def test_files_and_report(run, pair, result, tmp_path):
    files = [tmp_path / name for name in ("depth.png", "cloud.ply", "preview.jpg", "pair.png")]
    depth, cloud, preview, rectified = files
    outputs = ("-o", depth, "--ply", cloud, "--preview", preview, "--rectified", rectified, "--steps", "2000")
    status, out, err = run(*arguments(pair), *outputs)
    assert (status, err) == (0, "")
    labels = [line.split()[0] for line in out.splitlines() if not line.startswith(" ")]
    assert labels == ["baseline", "disparity", "rows", "rotation", "distance", "share", "written"]
    assert out.startswith("baseline   0.2012 m,")
    assert f"{depth}: 16 bits, 2000 steps per m" in out
    assert all(str(file) in out for file in files)
    stored = om.read_image(depth)
    assert stored.dtype == np.uint16
    known = np.isfinite(result.distance)
    np.testing.assert_array_equal(stored > 0, known)
    np.testing.assert_allclose(stored[known] / 2000, result.distance[known], atol=0.51 / 2000)
    header, _, body = cloud.read_bytes().partition(b"end_header\n")
    count = int(known.sum())
    assert f"element vertex {count}\n".encode() in header
    vertices = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    assert len(vertices) == count
    np.testing.assert_allclose(vertices["xyz"], result.points()[0], rtol=1e-6)
    np.testing.assert_array_equal(vertices["rgb"], result.points()[1])
    assert om.read_image(preview).shape[1] == 440
    drawn = om.read_image(rectified)
    width = result.rectification.camera.width
    assert drawn.shape[1] >= 2 * width
    lines = (drawn == (255, 210, 0)).all(2).mean(1)
    assert (lines > 0.99).sum() >= 4


def test_arrays_hold_distances_and_standard_deviations(run, pair, result, tmp_path):
    assert run(*arguments(pair), "-o", tmp_path / "depth.npz")[0] == 0
    with np.load(tmp_path / "depth.npz") as stored:
        np.testing.assert_array_equal(stored["distance"], result.distance)
        np.testing.assert_array_equal(stored["sigma"], result.sigma)
    write_distances(tmp_path / "depth.npy", result.distance, result.sigma, 1000)
    np.testing.assert_array_equal(np.load(tmp_path / "depth.npy"), result.distance)
    distance = np.array([[1.0, 70.0, np.nan]])
    assert write_distances(tmp_path / "depth.png", distance, distance, 1000) == 1
    np.testing.assert_array_equal(om.read_image(tmp_path / "depth.png"), [[1000, 0, 0]])


def test_json(run, pair):
    status, out, err = run(*arguments(pair), "--json", "--min-distance", "1", "--max-sigma", "0.05")
    data = json.loads(out)
    assert (status, err) == (0, "")
    assert list(data) == KEYS
    assert data["baseline"] == pytest.approx(np.linalg.norm(RIGHT_FROM_LEFT.translation))
    assert 0.3 < data["share"] < 1
    assert 0.7 < data["distance"]["low"] < data["distance"]["median"] < data["distance"]["high"] < 6
    assert 0 < data["relative_sigma"] < 0.05
    assert data["row_difference"]["px"] < 0.3
    assert data["min_distance"] == pytest.approx(1, rel=0.05)  # of a whole disparity
    assert (data["reason"], data["warnings"]) == ("", [])


def test_objects_nearer_than_the_smallest_distance_cause_a_warning(run, pair, result):
    assert result.warnings == ()
    status, out, err = run(*arguments(pair), "--min-distance", "2")
    assert status == 0
    assert "for distances from 1.91 m" in out  # of a whole disparity
    assert "matched points are nearer than 1.91 m, the smallest distance that is searched" in err
    advised = float(err.split("--min-distance ")[1])
    true = np.load(pair / "left.npy")[result.known]
    assert advised < np.quantile(true, 0.05)
    assert "nearer" not in run(*arguments(pair), "--min-distance", advised)[2]


def test_masked_pixels_have_no_distance(pair, tmp_path):
    mask = np.zeros((330, 440), np.uint8)
    mask[:, :200] = 255
    om.write_image(tmp_path / "mask.png", mask)
    options = om.StereoOptions(mask_left=tmp_path / "mask.png")
    masked = om.stereo(pair / "left.png", pair / "right.png", pair / "rig.json", options)
    assert masked
    assert not masked.known[:, 200:].any()
    assert masked.known[:, :200].mean() > 0.2


@pytest.mark.parametrize(("axis", "angle", "status"), [("about the baseline", 0.05, 2), ("yaw", 0.03, 0)])
def test_a_rig_that_contradicts_the_images(run, pair, tmp_path, axis, angle, status):
    vector = [angle, 0.0, 0.0] if axis == "about the baseline" else [0.0, angle, 0.0]
    turned = om.Pose(so3.exp(vector) @ RIGHT_FROM_LEFT.rotation, RIGHT_FROM_LEFT.translation)
    om.save(rig_of(turned), tmp_path / "rig.json")
    found, out, err = run(*arguments(pair, tmp_path / "rig.json"), "--json")
    data = json.loads(out)
    assert found == status
    assert data["rotation_from_rig_deg"] == pytest.approx(np.degrees(angle), abs=0.2)
    (warning,) = data["warnings"]
    assert "the images contradict the rig, and distances may be wrong or missing" in warning
    assert warning in err
    if status:  # rows do not match, so that no distance is accurate enough
        assert data["row_difference"]["px"] > 3
        assert data["reason"] == warning


def test_images_of_different_times_contradict_the_rig(pair, scene):
    """The rig moved between the images, across its baseline by 15 % of it: distances off-axis are wrong by as much."""
    moved = om.Pose(translation=np.array([0.0, 0.0, 0.03])) @ RIGHT_FROM_LEFT
    late = Renderer(CAMERA, SETUP.world_from_cam @ moved.inverse(), scene, samples=1, theta=SETUP.theta)
    check = om.stereo(om.read_image(pair / "left.png"), late().image, pair / "rig.json").check
    assert check.row_px < 1
    assert check.rotation_deg < 4 * check.rotation_sigma_deg
    assert check.direction_deg == pytest.approx(np.degrees(np.arctan(0.15)), abs=1.0)
    assert "the cameras of the rig took both images at the same time" in check.warning


def test_images_without_distances(run, pair, tmp_path):
    left, right, rig = pair / "left.png", pair / "right.png", ("--rig", pair / "rig.json")
    assert failure(run, "stereo", left, left, *rig).startswith("the images are identical")
    assert failure(run, "stereo", right, left, *rig).startswith("the images are exchanged")
    om.write_image(tmp_path / "wall.png", np.full((330, 440), 120, np.uint8))
    reason = failure(run, "stereo", left, tmp_path / "wall.png", *rig)
    assert "wall.png has 0 keypoints: it shows no texture" in reason
    blocks = np.random.default_rng(0).integers(0, 256, (66, 88), np.uint8)
    om.write_image(tmp_path / "noise.png", np.kron(blocks, np.ones((5, 5), np.uint8)))
    status, out, err = run("stereo", left, tmp_path / "noise.png", *rig, "-o", tmp_path / "depth.png")
    assert (status, out) == (2, "")
    assert "the images show nothing in common" in err
    assert not (tmp_path / "depth.png").exists()


def test_unusable_rigs_are_refused(refuses, pair, tmp_path):
    def error(rig, *further):
        om.save(rig, tmp_path / "other.json")
        return refuses(*arguments(pair, tmp_path / "other.json"), *further)

    assert "the baseline is 0: stereo needs two cameras in different places" in error(rig_of(om.Pose()))
    three = rig_of(RIGHT_FROM_LEFT, rear=(CAMERA, om.Pose(np.eye(3), np.ones(3))))
    assert "has 3 cameras (left, right, rear)" in error(three)
    assert "--cameras left,right" in error(three)
    assert "has no camera 'top' (--cameras); it has left, right, rear" in error(three, "--cameras", "left,top")
    assert "must be the names of two cameras" in error(three, "--cameras", "left")
    om.save(CAMERA, tmp_path / "camera.json")
    assert "camera.json" in refuses(*arguments(pair, tmp_path / "camera.json"))
    assert "missing.json" in refuses(*arguments(pair, tmp_path / "missing.json"))


def test_a_rig_is_required(run, pair):
    status, out, err = run("stereo", pair / "left.png", pair / "right.png")
    assert status == 2
    assert "--rig" in out + err


def test_a_rig_of_several_cameras_and_their_names(pair):
    three = om.Rig.from_sensors(
        {
            "rear": (CAMERA, om.Pose(np.eye(3), np.ones(3))),
            "b": (CAMERA, RIGHT_FROM_LEFT),
            "a": (CAMERA, om.Pose()),
        }
    )
    images = om.read_image(pair / "left.png"), om.read_image(pair / "right.png")
    named = om.stereo(*images, three, om.StereoOptions(cameras="a, b"))
    assert named
    np.testing.assert_allclose(named.right_from_left.rotation, RIGHT_FROM_LEFT.rotation, atol=1e-12)


def test_invalid_files_and_options_are_refused(refuses, pair, tmp_path):
    om.write_image(tmp_path / "half.png", np.zeros((165, 220), np.uint8))
    rig = "--rig", pair / "rig.json"
    message = refuses("stereo", tmp_path / "half.png", pair / "right.png", *rig)
    assert "half.png: the image is 220x165, the camera 440x330" in message
    assert "--scale-camera" in message
    assert "missing.png" in refuses("stereo", pair / "left.png", tmp_path / "missing.png", *rig)
    assert "depth.jpg: distances cannot be written as .jpg" in refuses(*arguments(pair), "-o", tmp_path / "depth.jpg")
    assert "left.png" in refuses(*arguments(pair), "-o", pair / "left.png")
    assert "there is no folder" in refuses(*arguments(pair), "--ply", tmp_path / "none" / "cloud.ply")
    both = "-o", tmp_path / "d.png", "--preview", tmp_path / "d.png"
    assert "d.png: is specified for two outputs" in refuses(*arguments(pair), *both)
    assert "must be larger than the baseline" in refuses(*arguments(pair), "--min-distance", "0.1")
    assert "--max-sigma is 0" in refuses(*arguments(pair), "--max-sigma", "0")
    assert "--steps must be positive" in refuses(*arguments(pair), "--steps", "0")
    om.write_image(tmp_path / "black.png", np.zeros((330, 440), np.uint8))
    assert "black.png: excludes all pixels" in refuses(*arguments(pair), "--mask-left", tmp_path / "black.png")
