"""Sequences whose images or clip specify a rotation: odometry, doctor, reconstruct and map with --apply-exif."""

import json

import numpy as np
import pytest

import omnisight as om
from clips import with_rotation, write_clip
from jpegs import jpeg
from omnisight.simulation.trajectory import read_trajectory
from walks import render_walk

FRAMES = 12
# EXIF orientation of an image that is rotated clockwise by 90 degrees for display.
CLOCKWISE = 6


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return the folder of a rendered sequence."""
    return render_walk(tmp_path_factory.mktemp("walk") / "room", FRAMES)


@pytest.fixture(scope="module")
def stored(room):
    """Return the images, rotated counterclockwise."""
    images = [om.read_image(path) for path in sorted((room / "images").iterdir())]
    assert len(images) == FRAMES
    return [np.ascontiguousarray(np.rot90(image)) for image in images]


@pytest.fixture(params=["images", "clip.mp4"])
def source(request, stored, tmp_path):
    """Return a folder or a clip that specifies the rotation back."""
    path = tmp_path / request.param
    if path.suffix:
        return with_rotation(write_clip(path, stored, "mp4v"))
    path.mkdir()
    for k, image in enumerate(stored):
        (path / f"{k:03}.jpg").write_bytes(jpeg(image[..., ::-1], CLOCKWISE))
    return path


def test_odometry_rotates_images_by_their_orientation(run, room, source):
    command = "odometry", source, "--camera", room / "camera.json", "-o", "t.tum", "--json"
    status, _, err = run(*command)
    assert status == 2
    assert "300x400" in err
    status, out, err = run(*command, "--apply-exif")
    assert (status, err) == (0, "")
    assert json.loads(out)["tracked"] == FRAMES
    pose, true = read_trajectory("t.tum").poses[-1], read_trajectory(room / "poses.txt").poses
    turn = pose.rotation.T @ true[0].rotation.T @ true[-1].rotation
    assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.5


def test_doctor_rotates_images_by_their_orientation(run, room, source):
    command = "doctor", source, "--camera", room / "camera.json"
    assert run(*command)[0] == 2
    assert run(*command, "--apply-exif")[0] == 0


def test_a_played_clip_is_rotated(run, room, stored, tmp_path):
    clip = with_rotation(write_clip(tmp_path / "clip.mp4", stored, "mp4v", frame_rate=4))
    command = "odometry", "--live", clip, "--camera", room / "camera.json", "-o", "t.tum", "--apply-exif"
    status, _, err = run(*command)
    assert (status, err) == (0, "")


@pytest.mark.parametrize("command", ["reconstruct", "map"])
def test_extracted_frames_are_rotated(run, room, stored, tmp_path, command):
    clip = with_rotation(write_clip(tmp_path / "clip.mp4", stored, "mp4v"))
    arguments = command, clip, "--camera", room / "camera.json", "-o", "model", "--fps", 24
    assert run(*arguments)[0] == 2
    assert run(*arguments, "--apply-exif")[0] == 0
