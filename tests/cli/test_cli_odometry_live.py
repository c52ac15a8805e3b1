"""omnisight odometry --live, of a rendered clip in place of a camera."""

import json
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest

import omnisight as om
from clips import write_clip
from omnisight.cli._odometry_live import live_view
from omnisight.compilation import report_compilation
from omnisight.images.live_camera import LiveCamera
from omnisight.pipeline.odometry.frame_sequence import SequenceFrame
from omnisight.pipeline.odometry.odometry import live_odometry
from omnisight.report.drawings.odometry import draw_path
from omnisight.simulation.trajectory import read_trajectory
from omnisight.visual_odometry.odometry import Odometry
from omnisight.visual_odometry.warm_up import FRAMES as WARM_UP_FRAMES
from walks import render_walk

FRAMES, RATE = 20, 4


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Return a folder with a clip of a walk, its camera and its images."""
    folder = render_walk(tmp_path_factory.mktemp("walk") / "room", FRAMES)
    images = [om.read_image(path) for path in sorted((folder / "images").iterdir())]
    write_clip(folder / "clip.avi", images, frame_rate=RATE)
    return folder


def test_a_played_clip_gives_the_trajectory_and_counts_dropped_frames(run, walk):
    start = time.monotonic()
    status, out, err = run(
        "odometry", "--live", walk / "clip.avi", "--camera", walk / "camera.json", "-o", "t.tum", "--json"
    )
    assert err == ""
    assert status == 0
    assert time.monotonic() - start > (FRAMES - 1) / RATE
    data = json.loads(out)
    assert data["frames"] + data["dropped"] == FRAMES
    assert data["tracked"] >= 0.8 * data["frames"]
    written = read_trajectory("t.tum")
    assert np.allclose(np.array(written.times) * RATE, np.rint(np.array(written.times) * RATE), atol=1e-6)


def test_late_frames_are_dropped_and_counted(walk):
    camera = LiveCamera(walk / "clip.avi")
    times = []
    for frame in camera.frames():
        times.append(frame.seconds)
        time.sleep(2.2 / RATE)
    assert 0 < camera.dropped < FRAMES
    assert len(times) + camera.dropped == FRAMES
    assert np.all(np.diff(times) > 0.9 / RATE)


def test_a_camera_is_followed_by_its_number_until_it_ends(run, walk, monkeypatch):
    class Camera:
        def __init__(self, number):
            assert number == 2
            self.frames = iter(sorted((walk / "images").iterdir()))

        def set(self, *_):
            return True

        def read(self):
            time.sleep(0.2)
            file = next(self.frames, None)
            return file is not None, None if file is None else cv2.imread(str(file))

        def release(self):
            pass

    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    status, out, _ = run("odometry", "--live", "2", "--camera", walk / "camera.json", "-o", "t.tum")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == ["frames", "path", "dropped", "time", "written"]


def test_ctrl_c_is_the_usual_end(run, walk, monkeypatch):
    added = Odometry.add
    count = 0

    def add(self, image, seconds):
        nonlocal count
        count += 1
        if count == WARM_UP_FRAMES + 14:
            raise KeyboardInterrupt
        return added(self, image, seconds)

    monkeypatch.setattr(Odometry, "add", add)
    images = walk / "clip.avi"
    result = live_odometry(str(images), om.load(walk / "camera.json"))
    assert result.frames == 13
    assert result


def test_code_is_loaded_between_the_check_of_the_camera_and_its_first_image(walk, monkeypatch):
    steps = []
    opened = LiveCamera.__init__
    monkeypatch.setattr(LiveCamera, "__init__", lambda *a, **b: (steps.append("opened"), opened(*a, **b))[1])
    camera = om.load(walk / "camera.json")
    options = om.OdometryOptions(loops=False)
    live_odometry(str(walk / "clip.avi"), camera, options, None, lambda *_: None, lambda *report: steps.append(report))
    assert steps[1][:2] == ("loading code before the first image", 0)
    assert [step[1] == step[2] for step in steps if step != "opened"] == [False] * (len(steps) - 3) + [True]
    assert steps[0] == steps[-1] == "opened"


def test_a_camera_that_does_not_fit_is_refused_before_code_is_loaded(walk):
    camera, steps = om.load(walk / "camera.json"), []
    watch = [lambda *_: None, lambda *report: steps.append(report)]
    with pytest.raises(ValueError, match="is it connected"):
        live_odometry(99, camera, om.OdometryOptions(), None, *watch)
    with pytest.raises(ValueError, match="the image is 400x300, the camera 123x45"):
        live_odometry(str(walk / "clip.avi"), replace(camera, size=(123, 45)), om.OdometryOptions(), None, *watch)
    assert not steps


def test_the_terminal_shows_that_code_is_loaded(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with live_view("0", has_page=False) as (_, progress):
        progress("loading code before the first image", 3, 10)
        report_compilation("align", None)
    assert capsys.readouterr().err.split("\x1b[K") == [
        "\rloading code before the first image: 3 of 10",
        "\rcompiling code (first run): align",
        "\r",
        "",
    ]


def test_the_page_shows_tracks_path_and_figures(walk, browser, capsys):
    panels = []
    with live_view("clip.avi", has_page=True) as (watch, _):
        url = capsys.readouterr().err.split()[-1]
        tracking = Odometry(om.load(walk / "camera.json"))
        for index, path in enumerate(sorted((walk / "images").iterdir())):
            image = om.read_image(path)
            tracking.add(image, index / 10)
            watch(tracking, SequenceFrame(index, index / 10, (image,)))
            panels.append(draw_path(tracking, 300))
        tab, errors = browser.new_page(), []
        tab.on("console", lambda message: errors.append(message.text))
        tab.goto(url)
        tab.wait_for_function("() => document.querySelector('img').naturalWidth > 1000")
        assert errors == []
        assert tab.inner_text("h1") == "Odometry of clip.avi"
        assert tab.inner_text("#advice") == "tracking"
        assert tab.inner_text("dl").splitlines()[::2][:4] == ["Frames", "Dropped", "Rate", "Path"]
        tab.close()
    blue = (panels[-1][..., 2] > 200) & (panels[-1][..., 0] < 120)
    assert blue.sum() > 100
    assert (panels[-1] != panels[FRAMES // 2]).any()


def test_what_cannot_be_followed_is_refused(refuses, run, walk):
    camera = walk / "camera.json"
    assert "neither the number" in refuses("odometry", "--live", "room", "--camera", camera, "-o", "t.tum")
    assert "--camera" in refuses("odometry", "--live", "0", "-o", "t.tum")
    assert "--live" in refuses("odometry", walk / "images", "--page", "--camera", camera, "-o", "t.tum")
    assert "camera 97" in refuses("odometry", "--live", "97", "--camera", camera, "-o", "t.tum")
