"""omnisight odometry, on rendered images of a room."""

import dataclasses
import itertools
import json
import shutil

import numpy as np
import pytest

import omnisight as om
from clips import write_clip
from omnisight.images import Clip
from omnisight.simulation.trajectory import read_trajectory
from omnisight.visual_odometry.loop_result import Loop, LoopClosure
from walks import render_walk

FRAMES = 14


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return the folder of a rendered sequence."""
    return render_walk(tmp_path_factory.mktemp("walk") / "room", FRAMES)


def arguments(room, *more):
    output = () if "-o" in more else ("-o", "t.tum")
    return "odometry", room / "images", "--camera", room / "camera.json", *output, *more


def test_the_trajectory_and_its_figures(run, room, tmp_path):
    status, out, err = run(*arguments(room))
    assert (status, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert [row[0] for row in rows] == ["frames", "path", "time", "written"]
    assert rows[0][1:6] == ["14", "of", "14", "have", "a"]
    assert "scale is unknown" in out
    written = read_trajectory("t.tum")
    true = read_trajectory(room / "poses.txt")
    assert np.allclose(written.times, true.times)
    turn = written.poses[-1].rotation.T @ true.poses[0].rotation.T @ true.poses[-1].rotation
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.3


def test_json_has_all_figures(run, room):
    status, out, _ = run(*arguments(room, "--json"))
    assert status == 0
    data = json.loads(out)
    assert data["frames"] == data["tracked"] == FRAMES
    assert data["keyframes"] > 2
    assert data["path_length"] > 1
    assert data["fps"] > 0
    assert (data["loops"], data["lost"], data["warnings"], data["has_scale"]) == (0, [], [], False)


def test_closed_loops_replace_the_trajectory_and_are_listed(run, room, monkeypatch):
    def close(tracking):
        moved = [
            dataclasses.replace(pose, rig_from_world=om.Pose(pose.rig_from_world.rotation, np.array((0.0, 0.0, k))))
            for k, pose in enumerate(tracking.trajectory)
        ]
        loops = [Loop(k, 10 + k, om.Pose(), 1.02, 50, 40 + k, 0.75) for k in range(3)]
        return LoopClosure(tuple(moved), tuple(loops[:2]), tuple(loops[2:]), 13.0)

    monkeypatch.setattr(om.Odometry, "close_loops", close)
    status, out, _ = run(*arguments(room))
    assert status == 0
    assert "loops       2 closed, which moved poses by up to 13 baselines; 1 similar places rejected" in out
    assert "frames 10 to 11 return to 0 to 1: 2 loops of 40 to 41 points" in out
    assert np.allclose([np.linalg.norm(p.translation) for p in read_trajectory("t.tum").poses], range(FRAMES))
    data = json.loads(run(*arguments(room, "--json"))[1])
    assert (data["loops"], data["loop_correction"]) == (2, 13.0)
    assert [loop["first"] for loop in data["loop_list"]] == [0, 1]
    assert data["loop_list"][0] == {
        "first": 0,
        "last": 10,
        "matches": 50,
        "inliers": 40,
        "directions": 0.75,
        "distance": 0.0,
        "scale": 1.02,
    }
    assert [loop["last"] for loop in data["rejected_loops"]] == [12]
    data = json.loads(run(*arguments(room, "--json", "--no-loops"))[1])
    assert data["loops"] == 0
    assert np.linalg.norm(read_trajectory("t.tum").poses[0].translation) < 1e-6


def test_times_are_those_of_a_file_or_of_a_rate(run, room, tmp_path):
    folder = tmp_path / "images"
    shutil.copytree(room / "images", folder)
    names = sorted(path.name for path in folder.iterdir())
    command = "odometry", folder, "--camera", room / "camera.json", "-o", "t.tum"
    times = tmp_path / "times.csv"
    times.write_text("name,seconds\n" + "".join(f"{name},{5 + 0.2 * k}\n" for k, name in enumerate(names)))
    assert run(*command)[0] == 0
    assert np.allclose(read_trajectory("t.tum").times, 5 + 0.2 * np.arange(FRAMES))
    assert run(*command, "--fps", "20")[0] == 0
    assert np.allclose(read_trajectory("t.tum").times, 0.05 * np.arange(FRAMES))
    times.write_text("".join(f"{name},1.5\n" for name in names))
    assert "is not after 1.5 s of the one before" in run(*command)[2]
    times.write_text(f"{names[0]},1.5\n")
    assert f"has no time of {names[1]}: add the line {names[1]},seconds" in run(*command)[2]
    times.write_text(f"{names[0]},1.5\n{names[1]},soon\n")
    assert "times.csv, line 2: expected name,seconds" in run(*command)[2]


def test_kitti_has_a_row_for_each_image_also_for_one_that_cannot_be_read(run, room, tmp_path):
    folder = tmp_path / "images"
    shutil.copytree(room / "images", folder)
    broken = sorted(folder.iterdir())[8]
    broken.write_bytes(broken.read_bytes()[:500])
    status, out, _ = run("odometry", folder, "--camera", room / "camera.json", "-o", "t.kitti")
    assert status == 0
    assert f"frame 8: {broken.name}" in out
    rows = np.loadtxt("t.kitti")
    assert rows.shape == (FRAMES, 12)
    assert np.flatnonzero(np.isnan(rows).any(axis=1)).tolist() == [8]
    assert np.allclose(rows[0].reshape(3, 4), np.eye(3, 4), atol=1e-6)


def test_an_image_of_another_size_or_an_unreadable_first_image_is_lost(run, room, tmp_path):
    folder = tmp_path / "images"
    shutil.copytree(room / "images", folder)
    om.write_image(folder / "000006.jpg", om.read_image(folder / "000006.jpg")[::2, ::2])
    (folder / "000000.jpg").write_bytes(b"")
    camera = "--camera", room / "camera.json"
    status, out, _ = run("odometry", folder, *camera, "-o", "t.tum", "--json")
    assert status == 0
    data = json.loads(out)
    assert data["tracked"] == FRAMES - 2
    reasons = {part["first"]: part["reason"] for part in data["lost"]}
    assert reasons[0] == "000000.jpg: empty file"
    assert reasons[6] == "000006.jpg: is 200x150 px, and images before 400x300"
    status, out, err = run("doctor", folder, *camera)
    assert (status, err) == (0, "")
    assert "2 cannot be used, the first: 000000.jpg: empty file" in out


@pytest.mark.parametrize("command", ["odometry", "doctor"])
def test_the_option_that_the_message_proposes_scales_the_camera(run, room, tmp_path, command):
    camera = om.load(room / "camera.json").scaled(2.0)
    om.save(dataclasses.replace(camera, size=(800, 600)), tmp_path / "large.json")
    output = ("-o", "t.tum") if command == "odometry" else ()
    arguments = command, room / "images", "--camera", tmp_path / "large.json", *output
    status, out, err = run(*arguments)
    assert status == 2
    assert "scale the camera (--scale-camera)" in out + err
    status, _, err = run(*arguments, "--scale-camera")
    assert (status, err) == (0, "")


def test_a_truncated_clip_is_reported(run, room, tmp_path):
    write_clip(tmp_path / "whole.avi", [om.read_image(path) for path in sorted((room / "images").iterdir())])
    data = (tmp_path / "whole.avi").read_bytes()
    (tmp_path / "clip.avi").write_bytes(data[: len(data) * 3 // 4])
    camera = "--camera", room / "camera.json"
    status, out, _ = run("odometry", tmp_path / "clip.avi", *camera, "-o", "t.tum", "--json")
    assert status == 0
    count = json.loads(out)["frames"]
    assert 7 < count < FRAMES
    note = f"clip.avi: ends after {count} of {FRAMES} frames: is the copy truncated?"
    assert json.loads(out)["warnings"] == [note]
    _, out, _ = run("doctor", tmp_path / "clip.avi", *camera)
    assert note in out
    for command in ("reconstruct", "map"):
        status, _, err = run(command, tmp_path / "clip.avi", *camera, "-o", command, "--fps", 24)
        assert (status, err.splitlines()) == (0, [f"omnisight: warning: {note}"])


def test_a_clip_is_read_to_its_end(run, room, tmp_path, monkeypatch):
    write_clip(tmp_path / "clip.avi", [om.read_image(path) for path in sorted((room / "images").iterdir())])
    monkeypatch.setitem(Clip.frames.__kwdefaults__, "limit", 7)  # of calibrations: minutes of a clip
    status, out, _ = run("odometry", tmp_path / "clip.avi", "--camera", room / "camera.json", "-o", "t.tum", "--json")
    assert (status, json.loads(out)["frames"]) == (0, FRAMES)
    assert len(om.extract_frames(tmp_path / "clip.avi", tmp_path / "images", fps=1000)) == FRAMES


def test_images_without_motion_are_refused_with_the_reason(run, room, tmp_path, refuses):
    folder = tmp_path / "still"
    folder.mkdir()
    for k in range(4):
        shutil.copy(sorted((room / "images").iterdir())[0], folder / f"{k}.jpg")
    command = "odometry", folder, "--camera", room / "camera.json", "-o", "t.tum"
    assert "the camera only turned, or did not move" in refuses(*command)
    assert len(read_trajectory("t.tum").poses) == 4
    for path in sorted(folder.iterdir())[1:]:
        path.unlink()
    assert "one image shows no motion" in refuses(*command)


def test_unknown_cameras_are_refused(run, room, refuses):
    command = "odometry", room / "images", "-o", "t.tum"
    assert "only 2:1 equirectangular images need no camera" in refuses(*command)
    assert "odometry needs a calibrated camera" in refuses(*command, "--camera", "auto")
    assert "--fps must be positive" in refuses(*command, "--fps", "0")


@pytest.mark.parametrize("name", ["images/000000.jpg", "camera.json", "images/times.csv", "wheels.csv"])
def test_inputs_are_not_overwritten(room, tmp_path, refuses, name):
    copy = shutil.copytree(room, tmp_path / "copy")
    times = [f"{k:06d}.jpg,{k / 10}" for k in range(FRAMES)]
    (copy / "images" / "times.csv").write_text("\n".join(times))
    (copy / "wheels.csv").write_text("0,1\n2,1\n")
    before = (copy / name).read_bytes()
    message = refuses(*arguments(copy, "--wheels", copy / "wheels.csv", "-o", copy / name))
    assert f"{copy / name}: is one of the inputs and would be overwritten" in message
    assert (copy / name).read_bytes() == before


def test_a_wrong_camera_causes_a_warning(run, room, tmp_path):
    camera = om.load(room / "camera.json")
    model = dataclasses.replace(camera.model, fx=1.3 * camera.model.fx, fy=1.3 * camera.model.fy)
    om.save(dataclasses.replace(camera, model=model), tmp_path / "wrong.json")
    status, _, err = run("odometry", room / "images", "--camera", tmp_path / "wrong.json", "-o", "t.tum")
    assert status == 0
    assert err.startswith("omnisight: warning: the images contradict the camera")


def test_an_interrupted_run_keeps_its_poses(run, room, monkeypatch):
    add, count = om.Odometry.add, iter(range(100))

    def interrupted(self, images, seconds):
        if next(count) == 8:
            raise KeyboardInterrupt
        return add(self, images, seconds)

    monkeypatch.setattr("omnisight.visual_odometry.odometry.Odometry.add", interrupted)
    status, _, err = run(*arguments(room))
    assert status == 130
    assert "t.tum holds the poses so far" in err
    assert len(read_trajectory("t.tum").poses) == 8


@pytest.mark.parametrize("name", ["t.tum", "t.kitti"])
@pytest.mark.parametrize("interrupts", [False, True])
def test_a_run_without_poses_keeps_an_earlier_trajectory(run, room, tmp_path, monkeypatch, name, interrupts):
    folder = tmp_path / "gray"
    folder.mkdir()
    for k in range(4):
        om.write_image(folder / f"{k}.png", np.full((300, 400), 128, np.uint8))
    (tmp_path / name).write_text("an earlier trajectory")
    if interrupts:
        monkeypatch.setattr("omnisight.visual_odometry.odometry.Odometry.finish", interrupt)
    status, _, err = run("odometry", folder, "--camera", room / "camera.json", "-o", tmp_path / name)
    assert status == (130 if interrupts else 2)
    assert "holds the poses so far" not in err
    assert (tmp_path / name).read_text() == "an earlier trajectory"
    (tmp_path / name).unlink()
    run("odometry", folder, "--camera", room / "camera.json", "-o", tmp_path / name)
    assert not (tmp_path / name).exists()


def interrupt(tracking):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "option", [("--height", "1.4m"), ("--distance", "0", "13", "1.2m")], ids=["height", "distance"]
)
def test_a_known_length_brings_the_trajectory_into_metres(run, room, option):
    status, out, _ = run(*arguments(room, "--json", *option))
    assert status == 0
    data = json.loads(out)
    poses = read_trajectory("t.tum").poses
    if option[0] == "--distance":
        assert data["unit"] == "m"
        assert np.linalg.norm(poses[13].translation - poses[0].translation) == pytest.approx(1.2, abs=1e-6)
        assert data["scale_source"] == "the distance of images 0 and 13"
    if not data["has_scale"]:
        assert data["scale_sigma"] is None
        assert data["warnings"]
        return
    assert 0 < data["scale_sigma"] < 0.1
    written = sum(np.linalg.norm(b.translation - a.translation) for a, b in itertools.pairwise(poses))
    assert data["path_length"] == pytest.approx(written, rel=1e-4)


def test_a_table_of_wheels_of_another_clock_leaves_the_scale_unknown(run, room, tmp_path):
    (tmp_path / "wheels.csv").write_text("1000,1\n1000.1,1\n1000.2,1\n")
    status, out, err = run(*arguments(room, "--wheels", tmp_path / "wheels.csv"))
    assert status == 0
    assert "the scale is unknown" in out
    assert "use the same clock for both" in err
