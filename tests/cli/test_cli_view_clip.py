"""omnisight view with clips, against remapped images and rendered motion."""

import contextlib
import json
from itertools import pairwise

import cv2
import numpy as np
import pytest

import omnisight as om
from clips import write_clip
from omnisight.geometry.rotation import exp
from omnisight.images import Clip
from omnisight.pipeline.views.view_renderer import hatch
from omnisight.simulation.trajectory import Trajectory, write_trajectory

COUNT, RATE, SIDE = 10, 20, 320


@pytest.fixture(scope="module")
def world():
    """A smooth panorama whose directions differ."""
    rng = np.random.default_rng(0)
    small = rng.integers(0, 255, (24, 48, 3), np.uint8)
    return cv2.resize(small, (1024, 512), interpolation=cv2.INTER_CUBIC)


@pytest.fixture(scope="module")
def rotations():
    """Rotations world_from_cam of a camera that shakes and turns slowly."""
    rng = np.random.default_rng(1)
    return [exp(np.array([0.0, 0.01 * k, 0.0]) + 0.05 * rng.standard_normal(3) * (k > 0)) for k in range(COUNT)]


@pytest.fixture(scope="module")
def source(world, rotations, tmp_path_factory):
    """Return a folder with the clip, its camera and its trajectory."""
    folder = tmp_path_factory.mktemp("clip")
    camera = om.Camera(om.fisheye(SIDE, 190.0).model, (SIDE, SIDE), theta_max=1.6)
    frames = [om.remap(world, om.sphere(1024), camera, r.T) for r in rotations]
    write_clip(folder / "clip.avi", frames, frame_rate=RATE)
    om.save(camera, folder / "camera.json")
    times = np.arange(COUNT) / RATE
    write_trajectory(folder / "poses.tum", Trajectory(times, tuple(om.Pose(r, np.zeros(3)) for r in rotations)))
    return folder


@pytest.fixture
def view(run, source, tmp_path):
    """Return a function that views the clip and returns the frames of all outputs, and what was printed."""

    def command(*arguments, outputs=("view.mp4",)):
        files = [tmp_path / name for name in outputs]
        named = [item for file in files for item in ("-o", file)]
        fixed = (source / "clip.avi", "--camera", source / "camera.json", "--size", "240x160", "--crf", "5")
        status, out, err = run("view", *fixed, *arguments, *named)
        assert (status, err) == (0, "")
        return [[frame.image for frame in Clip.open(file).frames()] for file in files], out

    return command


def expected(source, index, fov=70.0, rotation=None):
    (frame,) = Clip.open(source / "clip.avi").frames([index])
    camera = om.load(source / "camera.json")
    return om.remap(frame.image, camera, om.perspective((240, 160), fov), rotation)


def difference(a, b):
    return float(np.abs(a.astype(float) - b).mean())


def test_a_clip_is_viewed_like_its_images(source, view):
    (frames,), out = view("--fov", "70", "--yaw", "20")
    assert len(frames) == COUNT
    for k in (0, 7):
        assert difference(frames[k], expected(source, k, rotation=om.look(20))) < 4
    assert "view      perspective, 240x160" in out
    assert "frames    10 in" in out


def test_several_views_are_made_in_one_pass(source, view):
    outputs = "left.mp4", "wide.mkv"
    (left, wide), out = view("--yaw", "-30", "--yaw", "10", "--fov", "60", "--fov", "100", "--json", outputs=outputs)
    assert difference(left[3], expected(source, 3, 60.0, om.look(-30))) < 4
    assert difference(wide[3], expected(source, 3, 100.0, om.look(10))) < 4
    data = json.loads(out)
    assert data["frames"] == COUNT
    assert [entry["files"][0].rsplit("/")[-1] for entry in data["views"]] == list(outputs)


def test_only_a_sphere_of_all_directions_is_tagged_as_such(run, source, tmp_path):
    fixed = "view", source / "clip.avi", "--camera", source / "camera.json", "--size", "128x64"
    views = {"sphere.mp4": (), "part.mp4": ("--elevation", "-40:40"), "sphere.mkv": ()}
    for name, more in views.items():
        status, _, err = run(*fixed, "--to", "sphere", *more, "-o", tmp_path / name)
        assert (status, err) == (0, "")
        assert len(list(Clip.open(tmp_path / name).frames())) == COUNT
    assert {name: b"sv3d" in (tmp_path / name).read_bytes() for name in views} == {
        "sphere.mp4": True,
        "part.mp4": False,
        "sphere.mkv": False,
    }


def test_a_pan_turns_from_its_first_to_its_last_direction(source, view):
    (frames,), _ = view("--fov", "70", "--pan", "-40:41")
    for k, yaw in ((0, -40.0), (3, -13.0), (COUNT - 1, 41.0)):
        assert difference(frames[k], expected(source, k, rotation=om.look(yaw))) < 4


def test_the_coverage_of_a_moving_view_is_the_lowest(view):
    _, out = view("--fov", "70", "--pan", "0:90")
    assert "of the view is covered, at 0.45 s, where it is lowest" in out  # the last frame
    assert "outside the calibrated field of view\n" in out  # --mark, which hatches it, applies to fixed views
    _, out = view("--fov", "70", "--pan", "0:90", "--json")
    (data,) = json.loads(out)["views"]
    _, out = view("--fov", "70", "--yaw", "90", "--json")
    (last,) = json.loads(out)["views"]
    assert (data["time_s"], last["time_s"]) == (pytest.approx(0.45), None)
    assert [data[name] for name in ("view_fraction", "extrapolated_fraction")] == pytest.approx(
        [last[name] for name in ("view_fraction", "extrapolated_fraction")], abs=1e-3
    )


def test_keyframes_are_reached_and_not_exceeded(source, view, tmp_path):
    (tmp_path / "path.csv").write_text("time,yaw,fov\n0,-30,90\n0.2,30,60\n0.45,30,60\n", encoding="utf-8")
    (frames,), _ = view("--path", tmp_path / "path.csv")
    for k, yaw, fov in ((0, -30.0, 90.0), (4, 30.0, 60.0), (7, 30.0, 60.0), (9, 30.0, 60.0)):
        assert difference(frames[k], expected(source, k, fov, om.look(yaw))) < 4


def test_a_stabilized_view_stands_still(source, view):
    (frames,), _ = view("--fov", "60", "--stabilize", source / "poses.tum")
    (shaken,), _ = view("--fov", "60")
    moves = [max(difference(frame, clip[0]) for frame in clip) for clip in (frames, shaken)]
    assert moves[0] < 5
    assert moves[1] > 3 * moves[0]


def test_a_following_view_loses_the_shake_but_turns(source, view, rotations):
    (frames,), _ = view("--fov", "60", "--stabilize", source / "poses.tum", "--follow", "0.2")
    (shaken,), _ = view("--fov", "60")
    steps = [np.mean([difference(a, b) for a, b in pairwise(clip)]) for clip in (frames, shaken)]
    assert steps[0] < 0.5 * steps[1]
    assert difference(frames[0], frames[-1]) > 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "a.avi"), "a video is written as .mp4"),
        (("-o", "a.mp4", "--codec", "vp9"), "vp9 is not written in .mp4 files; use .mkv, .webm"),
        (("-o", "a.mp4", "--crf", "70"), "choose 0 (best) to 51"),
        (("-o", "a.webm", "--crf", "64"), "choose 0 (best) to 63"),
        (("-o", "a.mp4", "-o", "b.mp4", "--yaw", "1", "--yaw", "2", "--yaw", "3"), "--yaw is given 3 times"),
        (("-o", "a.mp4", "-o", "a.mp4"), "two views have the same file"),
        (("-o", "a.mp4", "--follow", "1"), "specify their file too"),
        (("-o", "a.mp4", "--pan", "0:9", "--yaw", "10"), "--yaw 10: --pan contains the yaw; leave out one of them"),
        (("-o", "a.mp4", "--path", "fov.csv", "--fov", "80"), "--fov 80: --path fov.csv contains the fov; leave out"),
        (("-o", "a.mp4", "--pan", "0:9", "--mark"), "views that do not move"),
        (("-o", "a.mp4", "--path", "bad.csv"), "bad.csv, line 3: expected 2 numbers, got '1,x'"),
        (("-o", "a.mp4", "--path", "header.csv"), "expected a header such as time,yaw,pitch,roll,fov"),
        (("-o", "a.mp4", "--path", "order.csv"), "order.csv, line 3: the times of keyframes must increase"),
        (("-o", "a.mp4", "--stabilize", "late.tum"), "has poses from 900 to 900 s, and the clip is from 0 to"),
        (("-o", "a.mp4", "--mask", "m.png"), "apply to one view of images"),
    ],
)
def test_unusable_options_are_refused_before_a_file_is_written(
    refuses, source, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.csv").write_text("time,yaw\n0,1\n1,x\n", encoding="utf-8")
    (tmp_path / "header.csv").write_text("t,y\n0,1\n", encoding="utf-8")
    (tmp_path / "order.csv").write_text("time,yaw\n1,1\n1,2\n", encoding="utf-8")
    (tmp_path / "fov.csv").write_text("time,fov\n0,60\n", encoding="utf-8")
    (tmp_path / "late.tum").write_text("900 0 0 0 0 0 0 1\n", encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    assert message in refuses("view", source / "clip.avi", "--camera", source / "camera.json", *arguments)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "note"),
    [
        (("--size", "241x161"), "240x160 instead of 241x161 px: video codecs need even sides"),
        (("--size", "240x160", "--to", "planet"), "160x160 instead of 240x160 px: a planet is square"),
        (("--size", "240x200", "--to", "cylinder"), "px: its height follows from the width and the field of view"),
        (("--size", "240", "--to", "cylinder"), None),
        (("--size", "240x160"), None),
    ],
)
def test_another_size_than_requested_is_noted(run, source, tmp_path, arguments, note):
    command = "view", source / "clip.avi", "--camera", source / "camera.json", "-o", tmp_path / "a.mp4"
    status, out, _ = run(*command, *arguments)
    assert status == 0
    assert ("note      " in out) is (note is not None)
    assert (note or "") in out


def test_an_interrupted_view_names_the_file_that_can_be_played(run, source, tmp_path, monkeypatch):
    def stop_at(stage, done, total):
        if done == 4:
            raise KeyboardInterrupt

    monkeypatch.setattr("omnisight.cli.view.progress", lambda: contextlib.nullcontext(stop_at))
    partial = tmp_path / "a.partial.mp4"
    status, _, err = run("view", source / "clip.avi", "--camera", source / "camera.json", "-o", tmp_path / "a.mp4")
    assert (status, err) == (130, f"omnisight: interrupted; {partial} has the first 4 frames\n")
    assert len(list(Clip.open(partial).frames())) == 4


def test_motion_needs_a_clip(refuses, shots, camera_file, tmp_path):
    error = refuses("view", shots / "1.png", "--camera", camera_file, "--pan", "0:9", "-o", tmp_path / "a.png")
    assert "apply to a clip" in error


def test_memory_does_not_depend_on_the_length_of_the_clip(source, tmp_path):
    """Frames wait in short queues: the decoder is never far ahead of the encoder."""
    from omnisight.parallel import prefetch

    taken = []

    def numbers():
        for k in range(1000):
            taken.append(k)
            yield k

    for k in prefetch(numbers(), 2):
        assert len(taken) <= k + 5
        if k == 50:
            break
    assert len(taken) < 60


def test_the_quality_of_the_codec_of_webm_is_up_to_63(tmp_path):
    assert om.VideoOptions(crf=60).codec_of(tmp_path / "a.webm") == "vp9"


def test_hatching_is_white_in_the_depth_of_the_image_and_keeps_alpha():
    everywhere = np.ones((20, 20), bool)
    luma = hatch(np.full((20, 20), 500, np.uint16), everywhere, 1023)
    assert set(np.unique(luma)) == {0, 500, 1023}
    assert (hatch(np.full((20, 20, 4), 200, np.uint8), everywhere)[..., 3] == 200).all()


def test_a_clip_is_not_read_and_written(refuses, source, tmp_path):
    clip = tmp_path / "p.partial.mkv"
    clip.write_bytes((source / "clip.avi").read_bytes())
    said = refuses("view", clip, "--camera", source / "camera.json", "--fov", "60", "-o", tmp_path / "p.mkv")
    assert "p.partial.mkv: is one of the inputs" in said
    assert clip.read_bytes() == (source / "clip.avi").read_bytes()
