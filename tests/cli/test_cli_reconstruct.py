"""omnisight reconstruct, on rendered images of a room whose poses are known."""

import csv
import errno
import json
import re

import cv2
import numpy as np
import pytest

import omnisight as om
from clips import write_clip
from jpegs import jpeg_at
from omnisight.geometry.rotation import exp
from omnisight.pipeline.reconstruction import reconstruct as pipeline
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.example_rigs import back_to_back
from sfm.worlds import similarity_errors

SPHERE = om.sphere(640)
POSES = [
    om.Pose(exp([0, 0.5 * k, 0]), np.array([0.35 * np.sin(1.1 * k), 0.1 * np.cos(k), 0.3 * k - 0.6])) for k in range(5)
]


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("room"), scene_named("room")
    for k, pose in enumerate(POSES):
        om.write_image(folder / f"{k}.png", Renderer(SPHERE, pose, scene, samples=1)().image)
    return folder


def test_poses_of_a_room_are_reconstructed_and_written(run, room, tmp_path):
    status, out, _ = run("reconstruct", room, "-o", tmp_path / "model", "--json")
    assert status == 0
    result = json.loads(out)
    assert (result["registered"], result["images"], result["models"]) == (5, 5, [5])
    assert result["reason"] == ""
    assert result["unregistered"] == {}
    assert 0 < result["rms_px"] < 1
    assert result["mean_track_length"] > 2
    assert result["peak_memory_mb"] > 100
    model = om.read_reconstruction(tmp_path / "model")
    assert model.names == tuple(f"{k}.png" for k in range(5))
    assert (len(model.points), len(model.observations)) == (result["points"], result["observations"])
    poses = np.array([pose.matrix for pose in model.rig_from_world])
    positions, rotations = similarity_errors(poses, [pose.inverse() for pose in POSES])
    assert positions.max() < 0.005
    assert rotations.max() < 0.1
    with (tmp_path / "model" / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    written = [[float(row[axis]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(written, [model.world_from_cam(k).translation for k in range(5)], atol=1e-6)


def test_the_report_lists_models_points_and_images_left_out(run, room, tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("0.png", "1.png", "2.png"):
        (folder / name).write_bytes((room / name).read_bytes())
    om.write_image(folder / "blank.png", np.full((320, 640, 3), 128, np.uint8))
    status, out, _ = run("reconstruct", folder, "-o", tmp_path / "model", "--pairs", "sequential", "--window", "2")
    assert status == 0
    assert (tmp_path / "model" / "viewer.html").stat().st_size > 10_000
    assert f"model       3 of 4 images, written to {tmp_path / 'model'}/" in out
    assert "left out    blank.png: 0 keypoints: the image shows no texture" in out


def test_frames_of_a_clip_are_reconstructed(run, room, tmp_path):
    frames = [om.read_image(room / f"{k // 2}.png") for k in range(10)]
    for frame in frames[::2]:  # the second of each pair is the sharper one
        frame[:] = cv2.blur(frame, (9, 9))
    clip = write_clip(tmp_path / "walk.avi", frames, frame_rate=10)
    status, out, _ = run("reconstruct", clip, "--fps", 5, "-o", tmp_path / "model")
    assert status == 0
    names = [f"walk-{k:06d}.jpg" for k in range(1, 10, 2)]
    assert sorted(path.name for path in (tmp_path / "model" / "images").iterdir()) == names
    model = om.read_reconstruction(tmp_path / "model")
    assert list(model.names) == names
    assert re.search(r"^time +\d+ s, \d+ MB of memory at most$", out, re.MULTILINE)
    positions, _ = similarity_errors(
        np.array([pose.matrix for pose in model.rig_from_world]), [pose.inverse() for pose in POSES]
    )
    assert positions.max() < 0.02


def test_one_image_is_refused_with_the_reason(run, room, tmp_path):
    status, out, err = run("reconstruct", room / "0.png", "-o", tmp_path / "model", "--json")
    assert status == 2
    assert json.loads(out)["reason"].startswith("one image shows no motion")
    assert "one image shows no motion" in err
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("stage", ["keypoints", "matching", "mapping"])
def test_an_interrupted_run_continues_and_gives_the_same_model(run, room, tmp_path, monkeypatch, stage):
    run("reconstruct", room, "-o", tmp_path / "whole")
    interrupted = pipeline.reconstruct

    def interrupt(images, camera, rig, options, progress, work):
        def stop(name, done, total):
            if name == stage and done >= total / 2:
                raise KeyboardInterrupt

        return interrupted(images, camera, rig, options, stop, work)

    with monkeypatch.context() as patch:
        patch.setattr(pipeline, "reconstruct", interrupt)
        status, _, err = run("reconstruct", room, "-o", tmp_path / "model")
    work = tmp_path / "model" / "work"
    assert status == 130
    assert f"continues from {work}" in err
    kept = {file.name: file.read_bytes() for file in work.iterdir()}
    assert len([name for name in kept if name.startswith("keypoints")]) >= 2
    first = work / sorted(kept)[0]
    first.write_bytes(first.read_bytes()[:1000])  # a damaged file is computed again
    assert run("reconstruct", room, "-o", tmp_path / "model")[0] == 0
    assert not work.exists()
    for name in ("poses.csv", "points.ply"):
        assert (tmp_path / "model" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_other_images_are_not_continued(run, room, tmp_path, monkeypatch):
    """What was kept belongs to the contents of the images, not to their names."""
    work, folder = tmp_path / "work", tmp_path / "images"
    folder.mkdir()
    for k in range(2):
        (folder / f"{k}.png").write_bytes((room / f"{k}.png").read_bytes())
    om.reconstruct(folder, work=work)
    kept = set(work.iterdir())
    (folder / "1.png").write_bytes((room / "3.png").read_bytes())
    om.reconstruct(folder, work=work)
    assert len(set(work.iterdir()) - kept) == 2  # the keypoints of the other image, and the pair


def test_similar_images_are_selected_once(room, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.pipeline.reconstruction.reconstruct.MAX_EXHAUSTIVE", 2)
    files, calls = sorted(room.glob("*.png"))[:3], []
    monkeypatch.setattr(
        "omnisight.pipeline.reconstruction.stored_stages.similar_pairs",
        lambda *arguments: calls.append(None) or om.similar_pairs(*arguments),
    )
    first, second = (om.reconstruct(files, work=tmp_path / "work") for _ in range(2))
    assert len(calls) == 1
    assert np.array_equal(*(each.models[0].points.position for each in (first, second)))


def test_a_full_disk_is_reported_and_the_earlier_model_kept(run, room, tmp_path, monkeypatch):
    model = tmp_path / "model"
    assert run("reconstruct", room, "-o", model)[0] == 0
    before = {path: path.read_bytes() for path in model.rglob("*") if path.is_file()}

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device", "disk")

    monkeypatch.setattr("omnisight.pipeline.inputs.work_folder.write_bytes", full)
    status, _, err = run("reconstruct", room, "-o", model)
    assert status == 2
    assert "No space left on device" in err
    assert {path: path.read_bytes() for path in model.rglob("*") if path.is_file()} == before


def test_identical_images_are_one_place(run, room, tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("a.png", "b.png"):
        (folder / name).write_bytes((room / "0.png").read_bytes())
    status, out, _ = run("reconstruct", folder, "-o", tmp_path / "model")
    assert status == 0
    assert "only their orientations are known" in out


def test_images_that_do_not_fit_the_camera_are_refused(run, room, tmp_path):
    om.save(om.sphere(800), tmp_path / "other.json")
    status, _, err = run("reconstruct", room, "--camera", tmp_path / "other.json", "-o", tmp_path / "model")
    assert status == 2
    assert "640x320" in err
    assert "800x400" in err


def test_a_known_distance_makes_a_model_metric(run, room, tmp_path):
    true = float(np.linalg.norm(POSES[4].translation - POSES[0].translation))
    status, out, _ = run("reconstruct", room, "--scale", "0", "4.png", f"{100 * true}cm", "-o", tmp_path / "model")
    assert status == 0
    assert "scale       metres" in out
    model = om.read_reconstruction(tmp_path / "model")
    positions = [model.world_from_cam(k).translation for k in range(5)]
    assert np.linalg.norm(positions[4] - positions[0]) == pytest.approx(true, rel=1e-6)
    for k in range(1, 5):
        expected = np.linalg.norm(POSES[k].translation - POSES[0].translation)
        assert np.linalg.norm(positions[k] - positions[0]) == pytest.approx(expected, rel=0.02)


def test_gps_tags_make_a_model_with_axes_east_north_up(run, room, tmp_path):
    """The room is 200 times larger, so that rounded tags are exact; its up is -y, and z points north."""
    folder = tmp_path / "images"
    to_north, to_east = np.radians(6_335_439.0), np.radians(6_378_137.0)  # metres per degree at the equator
    folder.mkdir()
    east_north_up = 200 * np.array([(pose.translation[0], pose.translation[2], -pose.translation[1]) for pose in POSES])
    for k, (east, north, up) in enumerate(east_north_up):
        latitude, longitude = north / to_north, 8.0 + east / to_east
        (folder / f"{k}.jpg").write_bytes(jpeg_at(om.read_image(room / f"{k}.png"), latitude, longitude, 400 + up))
    status, out, _ = run("reconstruct", folder, "--positions", "exif", "-o", tmp_path / "model", "--json")
    assert status == 0
    georeference = json.loads(out)["georeference"]
    assert georeference["images"] == 5
    assert georeference["inliers"] >= 4
    assert georeference["origin"][1] == pytest.approx(8.0 + east_north_up[0, 0] / to_east, abs=1e-6)
    model = om.read_reconstruction(tmp_path / "model")
    positions = np.array([model.world_from_cam(k).translation for k in range(5)])
    np.testing.assert_allclose(positions, east_north_up - east_north_up[0], atol=1.0)


def test_positions_of_a_table_are_used(run, room, tmp_path):
    rows = [f"{k}.png,{','.join(str(10 * x) for x in pose.translation)}" for k, pose in enumerate(POSES)]
    (tmp_path / "gps.csv").write_text("\n".join(["name,x,y,z", *rows, "other.png,1,2,3"]))
    status, out, _ = run("reconstruct", room, "--positions", tmp_path / "gps.csv", "-o", tmp_path / "model")
    assert status == 0
    assert "positions   5 of 5 agree within" in out
    model = om.read_reconstruction(tmp_path / "model")
    positions = [model.world_from_cam(k).translation for k in range(5)]
    np.testing.assert_allclose(positions, [10 * pose.translation for pose in POSES], atol=0.1)


@pytest.mark.parametrize(
    ("arguments", "table", "message"),
    [
        (("--positions", "exif"), "", "none of the 5 images has a valid position in its EXIF tags"),
        (("--positions", "{table}"), "a,b\n", "expected the columns name,x,y,z or name,latitude,longitude,altitude"),
        (("--positions", "{table}"), "name,x,y,z\n0.png,1,north,3\n", "gps.csv, line 2: could not convert"),
        (("--positions", "{table}"), "name,x,y,z\nno.png,1,2,3\n", "none of the 5 images has a valid position in"),
        (("--scale", "0", "9.png", "1m"), "", "9.png: no such image"),
        (("--scale", "0", "1", "3"), "", "has no unit"),
    ],
)
def test_measurements_that_cannot_be_used_are_refused(run, room, tmp_path, arguments, table, message):
    (tmp_path / "gps.csv").write_text(table)
    arguments = [argument.format(table=tmp_path / "gps.csv") for argument in arguments]
    status, _, err = run("reconstruct", room, *arguments, "-o", tmp_path / "model")
    assert status == 2
    assert message in err


@pytest.fixture(scope="module")
def rig_images(tmp_path_factory):
    """Return a folder with front/0.png, back/0.png ..., and the file of their rig, 0.2 m apart."""
    folder, scene, rig = tmp_path_factory.mktemp("rig"), scene_named("room"), back_to_back(400, apart=0.2)
    for name, camera, sensor_from_rig in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        (folder / "images" / name).mkdir(parents=True)
        for k, pose in enumerate(POSES):
            image = Renderer(camera, pose @ sensor_from_rig.inverse(), scene, samples=1)().image
            om.write_image(folder / "images" / name / f"{k}.png", image)
        om.save(camera, folder / f"{name}.json")
    om.save(rig, folder / "rig.json")
    return folder


def test_poses_of_a_rig_are_reconstructed_in_metres(run, rig_images, tmp_path):
    rig = ("--rig", rig_images / "rig.json")
    status, out, _ = run("reconstruct", rig_images / "images", *rig, "-o", tmp_path / "model", "--json")
    assert status == 0
    assert json.loads(out)["registered"] == 10
    assert 0 < json.loads(out)["scale_sigma"] < 0.05
    model = om.read_reconstruction(tmp_path / "model")
    assert model.has_scale
    assert len(model.rig_from_world) == 5
    assert set(model.names) == {f"{name}/{k}.png" for name in ("front", "back") for k in range(5)}
    positions = np.array([pose.inverse().translation for pose in model.rig_from_world])
    true = np.linalg.norm(POSES[4].translation - POSES[0].translation)
    assert np.linalg.norm(positions[4] - positions[0]) == pytest.approx(true, rel=0.02)


def test_an_uncertain_scale_of_a_rig_is_reported(run, rig_images, tmp_path, monkeypatch):
    arguments = rig_images / "images", "--rig", rig_images / "rig.json", "-o", tmp_path / "model"
    for sigma, text in ((0.3, "metres, ± 30.00% (1σ)"), (40.0, "unknown: the cameras of the rig are too close")):
        monkeypatch.setattr(om.Reconstruction, "scale_sigma", sigma)
        status, out, _ = run("reconstruct", *arguments)
        assert status == 0
        assert f"scale       {text}" in out
        assert "warning     the scale is uncertain" in out


def test_cameras_of_an_unknown_rig_are_reconstructed_with_it(run, rig_images, tmp_path):
    cameras = [item for name in ("front", "back") for item in ("--camera", f"{name}={rig_images / name}.json")]
    arguments = ("-o", tmp_path / "model", "--extrinsics", "unknown", "--json")
    status, out, _ = run("reconstruct", rig_images / "images", *cameras, *arguments)
    assert status == 0
    assert json.loads(out)["registered"] == 10
    model = om.read_reconstruction(tmp_path / "model")
    assert not model.has_scale
    assert om.load_rig(tmp_path / "model" / "rig.json").unit == model.rig.unit == "units"
    assert len(model.rig_from_world) == 5
    found = model.rig.sensor_from_rig[1] @ model.rig.sensor_from_rig[0].inverse()
    rotation = np.diag([-1.0, 1.0, -1.0])
    assert np.degrees(np.arccos((np.trace(found.rotation @ rotation.T) - 1) / 2)) < 0.3
    positions = np.array([pose.inverse().translation for pose in model.rig_from_world])
    step = np.linalg.norm(POSES[4].translation - POSES[0].translation)
    apart = np.linalg.norm(found.translation) / np.linalg.norm(positions[4] - positions[0])
    assert apart * step == pytest.approx(0.2, rel=0.25)


def test_images_of_no_camera_of_the_rig_are_refused(run, rig_images, tmp_path):
    om.save(back_to_back(400).subset(["front"]), tmp_path / "rig.json")
    status, _, err = run("reconstruct", rig_images / "images", "--rig", tmp_path / "rig.json", "-o", tmp_path / "model")
    assert status == 2
    assert "belongs to none of the cameras front" in err


def test_a_camera_without_calibration_is_estimated_with_a_warning(run, rig_images, tmp_path):
    status, out, _ = run("reconstruct", rig_images / "images" / "front", "-o", tmp_path / "model")
    assert status == 0
    assert "camera: has no calibration; estimated from the images: kannala_brandt, f = " in out
    true = om.load(rig_images / "front.json")
    found = om.read_reconstruction(tmp_path / "model").rig.cameras[0]
    theta = np.radians(np.arange(5, 86, 10))
    bearings = np.column_stack([np.sin(theta), 0 * theta, np.cos(theta)])
    radii = [camera.project(bearings)[0][:, 0] - camera.model.cx for camera in (true, found)]
    np.testing.assert_allclose(radii[1], radii[0], rtol=0.02)
    assert found.covariance is not None


@pytest.mark.peer
def test_the_engine_colmap_gives_the_model_of_the_same_images(run, room, rig_images, tmp_path):
    pytest.importorskip("pycolmap")
    status, out, _ = run("reconstruct", room, "--engine", "colmap", "-o", tmp_path / "model", "--json")
    assert status == 0
    assert json.loads(out)["registered"] == 5
    poses = np.array([pose.matrix for pose in om.read_reconstruction(tmp_path / "model").rig_from_world])
    positions, rotations = similarity_errors(poses, [pose.inverse() for pose in POSES])
    assert positions.max() < 0.005
    assert rotations.max() < 0.1
    arguments = ("--rig", rig_images / "rig.json", "--engine", "colmap-global", "-o", tmp_path / "of_rig")
    assert run("reconstruct", rig_images / "images", *arguments)[0] == 0
    model = om.read_reconstruction(tmp_path / "of_rig")
    assert len(model) == 10
    assert model.has_scale
    positions = [pose.inverse().translation for pose in model.rig_from_world]
    true = np.linalg.norm(POSES[4].translation - POSES[0].translation)
    assert np.linalg.norm(positions[4] - positions[0]) == pytest.approx(true, rel=0.02)


def test_the_engine_colmap_without_pycolmap_is_refused_with_the_remedy(run, room, tmp_path, monkeypatch):
    monkeypatch.setattr("omnisight.sfm.colmap_mapper.importlib.util.find_spec", lambda name: None)
    status, _, err = run("reconstruct", room, "--engine", "colmap", "-o", tmp_path / "model")
    assert status == 2
    assert "pip install 'omnisight[colmap]'" in err
    assert not (tmp_path / "model").exists()
