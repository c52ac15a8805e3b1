"""omnisight localize, on rendered images of a room whose poses are known."""

import csv
import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnisight as om
from omnisight.features import detect_features
from omnisight.geometry.rotation import exp
from omnisight.pipeline.reconstruction.detected_images import detect_images
from omnisight.sfm.georeference import robust_similarity
from omnisight.simulation import Renderer, scene_named

SPHERE, PHONE = om.sphere(640), om.perspective((480, 360), 80)
POSES = [
    om.Pose(exp([0, 0.4 * k, 0]), np.array([0.35 * np.sin(1.1 * k), 0.1 * np.cos(k), 0.25 * k - 0.6])) for k in range(6)
]
QUERIES = [om.Pose(exp([0.1, turn, 0]), np.array([0.1, 0.0, 0.05])) for turn in (0.3, 2.4)]


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Return a folder with images, a map of them, and images of a phone."""
    folder, scene = tmp_path_factory.mktemp("localize"), scene_named("room")
    for camera, poses, name in ((SPHERE, POSES, "images"), (PHONE, QUERIES, "phone")):
        (folder / name).mkdir()
        for k, pose in enumerate(poses):
            om.write_image(folder / name / f"{k}.png", Renderer(camera, pose, scene, samples=4)().image)
    om.save(PHONE, folder / "phone.json")
    visual_map, _ = om.build_map(folder / "images")
    assert visual_map is not None
    assert len(visual_map.reconstruction) == len(POSES)
    om.write_map(folder / "map", visual_map)
    return folder


def test_the_descriptor_of_an_observation_is_that_of_its_keypoint(known):
    visual_map, _ = om.build_map(known / "images")
    observations = visual_map.reconstruction.observations
    for image, name in enumerate(visual_map.reconstruction.names):
        keypoints = detect_features(om.read_image(known / "images" / name), SPHERE)
        rows = np.flatnonzero(observations.image == image)
        assert len(rows) > 50
        # Several keypoints of other orientations have the same pixel.
        assert len(np.unique(keypoints.pixels, axis=0)) < len(keypoints)
        seen = observations.keypoint[rows]
        assert (keypoints.pixels[seen] == observations.pixels[rows]).all()
        assert (visual_map.descriptors[rows] == keypoints.descriptors[seen]).all()


def test_descriptors_are_those_of_keypoints_that_the_reconstruction_kept(known, monkeypatch):
    """Self-calibration leaves out keypoints that the final camera does not see."""

    def without_first(*arguments):
        found = detect_images(*arguments)
        kept = {"keypoints": [each[1:] for each in found.keypoints], "colors": [each[1:] for each in found.colors]}
        return dataclasses.replace(found, **kept)

    monkeypatch.setattr("omnisight.pipeline.reconstruction.reconstruct.detect_images", without_first)
    visual_map, _ = om.build_map(known / "images")
    observations = visual_map.reconstruction.observations
    keypoints = detect_features(om.read_image(known / "images" / visual_map.reconstruction.names[0]), SPHERE)[1:]
    rows = np.flatnonzero(observations.image == 0)
    assert len(rows) > 50
    assert (visual_map.descriptors[rows] == keypoints.descriptors[observations.keypoint[rows]]).all()


def test_an_image_of_another_size_is_left_out_with_the_reason(run, known, tmp_path):
    (tmp_path / "phone").mkdir()
    om.write_image(tmp_path / "phone" / "upright.png", np.zeros((480, 360), np.uint8))
    options = "--map", known / "map", "--camera", known / "phone.json"
    status, _, err = run("localize", tmp_path / "phone", *options)
    assert status == 2
    assert "upright.png: the image is 360x480, the camera 480x360" in err
    image = om.read_image(known / "phone" / "0.png")
    om.write_image(tmp_path / "phone" / "0.png", image)
    found = om.localize(tmp_path / "phone", known / "map", known / "phone.json")
    assert found["0.png"]
    assert found["upright.png"].reason.startswith("the image is 360x480, the camera 480x360")
    status, out, err = run("localize", tmp_path / "phone", *options)
    assert status == 0
    assert "localized 1 of 2 images" in out
    assert "1 of 2 images cannot be used and are left out, the first is upright.png: the image is 360x480" in err


def test_images_of_another_camera_are_localized_within_their_uncertainty(run, known):
    poses = known / "poses.csv"
    arguments = known / "phone", "--map", known / "map", "--camera", known / "phone.json", "-o", poses, "--json"
    status, out, err = run("localize", *arguments)
    assert status == 0, err
    found = json.loads(out)
    assert found["localized"] == len(QUERIES)
    model = om.read_reconstruction(known / "map")
    centers = np.array([model.world_from_cam(k).translation for k in range(len(model))])
    truth = np.array([POSES[int(name.split(".")[0])].translation for name in model.names])
    metres_from_map, _ = robust_similarity(centers, truth)
    for image in found["images"]:
        query = QUERIES[int(image["name"].split(".")[0])]
        error = np.linalg.norm(metres_from_map @ np.array([image["position"]])[0] - query.translation)
        assert error < max(5 * metres_from_map.scale * image["sigma_position"], 0.01)
        covariance = np.array(image["covariance"])
        assert np.degrees(np.sqrt(np.trace(covariance[:3, :3]))) == pytest.approx(image["sigma_deg"])
        pose = om.Pose(Rotation.from_quat(image["rotation_xyzw"]).as_matrix(), np.array(image["position"])).inverse()
        assert np.trace(pose.position_covariance(covariance)) == pytest.approx(image["sigma_position"] ** 2)
    with poses.open(newline="") as file:
        assert [row["name"] for row in csv.DictReader(file)] == ["0.png", "1.png"]


@pytest.mark.parametrize("fov", [80, 82])
def test_a_wrong_focal_length_is_reported(run, known, tmp_path, fov):
    om.save(om.perspective((480, 360), fov), tmp_path / "camera.json")
    arguments = "localize", known / "phone", "--map", known / "map", "--camera", tmp_path / "camera.json"
    status, out, err = run(*arguments, "--json")
    assert status == 0, err
    change = json.loads(out)["focal_length_change"]
    if fov == 80:
        assert change is None
        assert err == ""
        return
    wrong = np.tan(np.radians(82 / 2)) / np.tan(np.radians(80 / 2)) - 1
    assert change["relative"] == pytest.approx(wrong, abs=5 * change["sigma"])
    assert "the images agree best with a focal length" in err
    _, out, err = run(*arguments)
    assert "longer than that of the calibration" in out
    assert "calibrate the camera (omnisight calibrate)" in err


def test_images_without_pose_have_a_reason(run, known, tmp_path):
    om.write_image(tmp_path / "gray.png", np.full((360, 480, 3), 128, np.uint8))
    table = tmp_path / "poses.csv"
    table.write_text("of an earlier run")
    given = "localize", tmp_path, "--map", known / "map", "--camera", known / "phone.json", "-o", table
    status, out, err = run(*given)
    assert status == 2
    assert "another place, or no texture" in out
    assert "written   nothing" in out
    assert "no image was localized" in err
    assert table.read_text() == "of an earlier run"


@pytest.mark.parametrize("name", ["map/poses.csv", "phone/0.png", "phone.json"])
def test_inputs_are_not_overwritten(refuses, known, name):
    before = (known / name).read_bytes()
    arguments = known / "phone", "--map", known / "map", "--camera", known / "phone.json", "-o", known / name
    assert "is one of the inputs" in refuses("localize", *arguments)
    assert (known / name).read_bytes() == before


def test_poses_in_a_map_of_unknown_uncertainty_are_written_without_it(run, known, tmp_path):
    made = om.read_map(known / "map")
    points = made.reconstruction.points
    points = dataclasses.replace(points, covariance=np.full_like(points.covariance, np.nan))
    made = dataclasses.replace(made, reconstruction=dataclasses.replace(made.reconstruction, points=points))
    om.write_map(tmp_path / "map", made)
    arguments = "localize", known / "phone", "--map", tmp_path / "map", "--camera", known / "phone.json"
    status, out, err = run(*arguments, "--json")
    assert status == 0, err
    found = json.loads(out)
    assert found["localized"] == len(QUERIES)
    assert {(each["sigma_deg"], each["sigma_position"], each["covariance"]) for each in found["images"]} == {
        (None,) * 3
    }
    assert "nan" not in run(*arguments)[1]


def test_a_map_of_images_from_one_place_is_warned_about(run, tmp_path):
    for k in range(3):
        pose = om.Pose(exp([0, 0.4 * k, 0.1 * k]), np.zeros(3))
        image = Renderer(om.sphere(480), pose, scene_named("room"), samples=4)().image
        om.write_image(tmp_path / f"{k}.png", image)
    status, out, err = run("map", tmp_path, "-o", tmp_path / "map")
    assert status == 0, err
    assert "warning   without points no image can be localized: take images from different places" in out


def test_poses_are_written_as_csv_only(refuses, known, tmp_path):
    arguments = known / "phone", "--map", known / "map", "--camera", known / "phone.json"
    message = refuses("localize", *arguments, "-o", tmp_path / "poses.tum")
    assert "poses.tum: the poses are written as .csv; name it poses.csv" in message
    assert repr(om.localize(known / "phone", known / "map", known / "phone.json")) == (
        "LocalizationResult(2 of 2 images localized)"
    )
