"""omnisight capture, of a rendered clip in place of a camera."""

import json
import re
import shutil
import time
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnisight as om
from clips import BOARD, POSE_COUNT, SETUP, rendered_clip, with_rotation, write_clip
from jpegs import jpeg
from omnisight.pipeline.calibration.capture import capture
from omnisight.pipeline.calibration.capture_source import CaptureSource
from omnisight.report.live.server import LivePage
from omnisight.targets.target_file import save_board


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Return a folder with the clip and the board."""
    folder = tmp_path_factory.mktemp("scene")
    write_clip(folder / "clip.avi", rendered_clip()[0])
    save_board(BOARD, folder / "board.json")
    return folder


def arguments(scene, *more):
    return "capture", scene / "clip.avi", "--target", scene / "board.json", "-o", "images", *more


def test_images_and_clips_are_rotated_as_they_specify(tmp_path):
    stored = [np.ascontiguousarray(np.rot90(frame)) for frame in rendered_clip()[0][:6]]
    clip = with_rotation(write_clip(tmp_path / "clip.mp4", stored, "mp4v"))
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "1.jpg").write_bytes(jpeg(stored[0][..., ::-1], 6))
    shape = stored[0].shape[1::-1]
    for source in (clip, tmp_path / "images"):
        for apply_exif, expected in ((False, shape[::-1]), (True, shape)):
            candidates = list(CaptureSource.open(str(source), apply_exif=apply_exif).candidates)
            assert len(candidates) > 0
            assert candidates[0].frame.image.shape[:2] == expected


class Camera:
    """A camera that shows the board for a while at rest, at two poses."""

    def __init__(self, number):
        assert number == 3
        frames, labels = rendered_clip()
        self.frames = iter([frames[labels.index(pose)] for pose in (0, 1) for _ in range(80)])

    def set(self, *_):
        return True

    def read(self):
        time.sleep(0.01)
        frame = next(self.frames, None)
        return frame is not None, None if frame is None else np.ascontiguousarray(frame[..., ::-1])

    def release(self):
        pass


def test_one_still_image_of_each_pose_is_stored_and_they_calibrate(run, scene):
    status, out, err = run(*arguments(scene))
    assert (status, err) == (0, "")
    frames, labels = rendered_clip()
    files = sorted(Path("images").iterdir())
    assert [file.name for file in files] == [f"capture-{k:03d}.png" for k in range(1, POSE_COUNT + 1)]
    stored = [om.read_image(file).astype(int) for file in files]
    shown = [labels[int(np.argmin([np.abs(frame - image).mean() for frame in frames]))] for image in stored]
    assert shown == list(range(POSE_COUNT))
    assert f"images    {POSE_COUNT} in images" in out
    (line,) = [line for line in out.splitlines() if line.startswith("calibrate")]
    assert line.split()[1:4] == ["omnisight", "calibrate", "images"]
    status, out, _ = run(*line.split()[2:], "--model", "eucm", "--json")
    assert status == 0
    camera = om.load("camera.json")
    pixels = [[150.0, 120.0], [240.0, 180.0], [330.0, 240.0]]
    found, true = (bearings for bearings, _ in (camera.unproject(pixels), SETUP.camera.unproject(pixels)))
    between, apart = (np.degrees(np.arccos(np.clip(b @ b.T, -1, 1))) for b in (found, true))
    assert apart[0, 2] > 110
    assert np.abs(between - apart).max() < 0.1


def test_a_second_run_continues_and_the_capture_ends_when_enough_is_covered(run, scene):
    options = "--images", "5", "--coverage", "40"
    status, out, _ = run(*arguments(scene, *options, "--json"))
    assert status == 0
    data = json.loads(out)
    assert data["reason"] == "coverage"
    assert len(data["images"]) == 5
    assert data["coverage"] >= 0.4
    assert data["next"].startswith("hold the board ")
    status, out, _ = run(*arguments(scene, "--json"))
    again = json.loads(out)
    assert again["reason"] == "end"
    assert again["images"][:5] == data["images"]
    assert len(again["images"]) == POSE_COUNT
    assert again["found"] < again["searched"]
    assert again["coverage"] > data["coverage"]


def test_a_camera_is_read_by_its_number(run, scene, monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    status, out, _ = run("capture", "3", "--target", scene / "board.json", "-o", "images", "--json")
    assert status == 0
    assert len(json.loads(out)["images"]) == 2


def test_the_page_is_served_on_this_computer_only(scene, tmp_path, browser):
    with LivePage("Capture <of> 0") as page:
        tab, errors = browser.new_page(), []
        tab.on("console", lambda message: errors.append(message.text))
        tab.goto(page.url)
        page.show(np.full((40, 60, 3), 90, np.uint8), "hold the board <still>", {"Images": "5 of 12"})
        tab.wait_for_function("() => document.querySelector('img').naturalWidth === 60")
        assert errors == []
        assert tab.inner_text("#advice") == "hold the board <still>"
        assert tab.inner_text("dd") == "5 of 12"
        assert tab.inner_text("h1") == "Capture <of> 0"
        assert page.url.startswith("http://127.0.0.1:")
        request = urllib.request.Request(page.url, headers={"Host": "example.org"})
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(request)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(page.url + "../pyproject.toml")
    tab.wait_for_function("() => document.getElementById('state').textContent.includes('ended')")
    tab.close()


def test_the_page_shows_the_capture(run, scene, monkeypatch):
    shown = []
    monkeypatch.setattr(LivePage, "show", lambda self, image, advice, rows: shown.append((image, advice, rows)))
    status, _, err = run(*arguments(scene, "--page", "--images", "4", "--coverage", "20"))
    assert status == 0
    assert err.startswith("page      http://127.0.0.1:")
    advice = [entry[1] for entry in shown]
    assert advice.count("stored") == 4
    assert {"stored", "move the board: this pose adds nothing new"} <= set(advice)
    last = shown[-1][2]
    assert last["Images"] == "4 of at least 4"
    assert last["Next"].startswith("hold the board ")
    # The directions without corners are red, which the image itself is not.
    red = [(entry[0][..., 0].astype(float) - entry[0][..., 2]).mean() for entry in (shown[0], shown[-1])]
    assert red[1] > red[0] + 5


def test_wrong_input_is_refused(refuses, run, scene, tmp_path):
    assert "--target board.json" in refuses("capture", scene / "clip.avi", "-o", "images")
    assert "camera 97: delivers no image" in refuses("capture", "97", "--pattern", "9x6", "-o", "images")
    (tmp_path / "file").touch()
    assert "is a file" in refuses(*arguments(scene)[:-1], tmp_path / "file")
    assert "--images must be 3 or more" in refuses(*arguments(scene, "--images", "2"))
    status, _, err = run("capture", scene / "clip.avi", "--pattern", "5x4", "-o", "others")
    assert status == 2
    counts = r"no image was stored: 0 of (\d+) frames show the board; advice: show the board \(\1 frames\)"
    assert re.search(counts, err)
    assert "--pattern counts inner corners" in err
    assert not Path("others").exists()
    assert "contains the images" in refuses("capture", scene, "--target", scene / "board.json", "-o", scene)


def test_the_printed_command_is_complete_for_a_folder_with_a_space(run, scene):
    status, out, _ = run(*arguments(scene)[:-1], "my images", "--images", "3", "--coverage", "1")
    assert status == 0
    assert "calibrate omnisight calibrate 'my images' --target" in out


def test_a_folder_of_clips_is_refused(refuses, scene, tmp_path):
    (tmp_path / "clips").mkdir()
    for name in ("a.avi", "b.avi"):
        shutil.copy(scene / "clip.avi", tmp_path / "clips" / name)
    message = refuses("capture", tmp_path / "clips", *arguments(scene)[2:])
    assert "contains clips, such as" in message


def test_images_of_another_size_are_not_continued(refuses, scene, tmp_path):
    (tmp_path / "images").mkdir()
    frame = rendered_clip()[0][0]
    om.write_image(tmp_path / "images" / "capture-001.png", np.ascontiguousarray(frame[:, :-80]))
    message = refuses(*arguments(scene)[:-1], tmp_path / "images")
    height, width = frame.shape[:2]
    assert f"clip.avi: {width}x{height} px, and the images so far are {width - 80}x{height} px" in message
    assert [file.name for file in (tmp_path / "images").iterdir()] == ["capture-001.png"]


def test_an_interruption_keeps_the_images(scene, tmp_path):
    def interrupt(session, seen):
        if len(session.detections.images) == 2:
            raise KeyboardInterrupt

    options = om.CaptureOptions(target=scene / "board.json")
    result = capture(scene / "clip.avi", tmp_path / "images", options, interrupt)
    assert result.reason == "interrupted"
    assert [file.name for file in result.images] == ["capture-001.png", "capture-002.png"]
    assert all(file.is_file() for file in result.images)


def test_an_interrupted_image_is_not_reported(scene, tmp_path, monkeypatch):
    def write(file, image):
        if file.name == "capture-002.png":
            raise KeyboardInterrupt
        om.write_image(file, image)

    monkeypatch.setattr("omnisight.pipeline.calibration.capture.write_image", write)
    result = capture(scene / "clip.avi", tmp_path / "images", om.CaptureOptions(target=scene / "board.json"))
    assert result.reason == "interrupted"
    assert [file.name for file in result.images] == ["capture-001.png"]
