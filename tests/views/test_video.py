"""Videos: decoding, invalid files, and the selection of frames for calibration."""

import contextlib
import re
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest

from calibrating import calibrate, observe
from clips import BOARD, FRAMES_AT_REST, FRAMES_IN_MOTION, POSE_COUNT, SETUP, rendered_clip, with_rotation, write_clip
from lenses import bearing_error
from omnisight.calibration import frame_selection
from omnisight.calibration.frame_information import select_informative_views
from omnisight.calibration.frame_selection import select_frames
from omnisight.images import Clip, UnreadableImage, collect_images, read_image, to_gray8
from omnisight.images.video import is_clip
from omnisight.images.video_files import VIDEO_SUFFIXES
from omnisight.simulation import fisheye_setup
from omnisight.targets import Checkerboard, clip_detection, detect_boards
from omnisight.targets.clip_detection import detect_in_clip


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """Keep detections and frames out of the user's cache; compiled code stays in the shared cache."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("omnisight.targets.cache.cache_folder", lambda: folder)
        patch.setattr("omnisight.calibration.frame_selection.frames_folder", lambda: folder / "frames")
        yield


@pytest.fixture(scope="module")
def labelled_clip(tmp_path_factory):
    """Return a clip of a board that rests at poses and moves between them, and the label of every frame."""
    frames, labels = rendered_clip()
    return write_clip(tmp_path_factory.mktemp("clip") / "clip.avi", frames), labels


@pytest.fixture(scope="module")
def detections(labelled_clip):
    return detect_in_clip(Clip.open(labelled_clip[0]))


def steps(count=10, size=(96, 64)):
    """Return frames whose brightness identifies their index."""
    ramp = np.linspace(0, 40, size[0])[None, :, None]
    return [np.broadcast_to(20 * i + ramp, (size[1], size[0], 3)).astype(np.uint8) for i in range(count)]


@pytest.fixture
def short(tmp_path):
    return write_clip(tmp_path / "short.avi", steps())


def test_frames_are_in_order_with_time_stamps(short):
    clip = Clip.open(short)
    assert (clip.size, clip.frame_rate, clip.declared_frames, clip.rotation_deg) == ((96, 64), 24, 10, 0)
    frames = list(clip.frames())
    assert [frame.index for frame in frames] == list(range(10))
    assert [frame.seconds for frame in frames] == pytest.approx(np.arange(10) / 24, abs=1e-3)
    for frame, written in zip(frames, steps(), strict=True):
        assert np.abs(frame.image.astype(float) - written).mean() < 2


def test_frames_are_rgb(tmp_path):
    red = np.zeros((64, 96, 3), np.uint8)
    red[..., 0] = 200
    (frame,) = Clip.open(write_clip(tmp_path / "red.avi", [red])).frames()
    assert frame.image.mean((0, 1)) == pytest.approx([200, 0, 0], abs=8)


def test_selected_frames_equal_those_of_a_full_read(short):
    clip = Clip.open(short)
    all_frames = list(clip.frames())
    for frame in clip.frames({2, 7}):
        assert (frame.image == all_frames[frame.index].image).all()
    assert [frame.index for frame in clip.frames({2, 7, 400})] == [2, 7]
    assert list(clip.frames(())) == []


def test_rotation_is_ignored_by_default(tmp_path):
    path = with_rotation(write_clip(tmp_path / "portrait.mp4", steps(), "mp4v"))
    stored, displayed = Clip.open(path), Clip.open(path, upright=True)
    assert (stored.size, displayed.size, stored.rotation_deg) == ((96, 64), (64, 96), 90)
    frame, upright = (next(clip.frames()).image.astype(int) for clip in (stored, displayed))
    assert np.abs(np.rot90(frame, -1) - upright).max() <= 4


BAD = {
    "empty": (lambda good: b"", "empty file; copy it from the camera again"),
    "text": (lambda good: b"plain text" * 99, "not a video (starts with the text 'plain textplain')"),
    "image": (
        lambda good: cv2.imencode(".png", np.zeros((9, 9), np.uint8))[1].tobytes(),
        "not a video (starts with the bytes 89 50 4e 47 0d)",
    ),
    "playlist": (lambda good: b"#EXTM3U\n#EXTINF:1,\nfile:///etc/hostname\n" * 20, "not a video"),
    "list": (lambda good: b"ffconcat version 1.0\nfile short.avi\n" * 20, "not a video"),
    "truncated": (lambda good: good[: len(good) // 2], "no index (moov): the recording or the copy is truncated"),
    "damaged": (lambda good: good[:32] + bytes(len(good) - 32), "no index (moov)"),
    "endless": (lambda good: good[:4] + b"free" + b"\0\0\0\x08free" * 5000, "no index (moov)"),
    "header": (lambda good: b"RIFF\0\0\0\0AVI LIST" + bytes(900), "ffmpeg -i bad.mp4"),
}


@pytest.mark.parametrize("how", BAD)
def test_error_of_an_invalid_file_has_name_reason_and_advice(tmp_path, capfd, how):
    good = write_clip(tmp_path / "good.mp4", steps(), "mp4v").read_bytes()
    make, message = BAD[how]
    (tmp_path / "bad.mp4").write_bytes(make(good))
    with pytest.raises(UnreadableImage, match=r"^bad\.mp4: .*" + re.escape(message)):
        list(Clip.open(tmp_path / "bad.mp4").frames())
    assert capfd.readouterr().err == ""  # the decoder prints nothing


def test_missing_files_and_folders_are_unreadable(tmp_path):
    with pytest.raises(UnreadableImage, match=r"gone\.mp4: no such file"):
        Clip.open(tmp_path / "gone.mp4")
    with pytest.raises(UnreadableImage):
        Clip.open(tmp_path)


def test_corrupt_files_decode_or_raise_unreadable(tmp_path):
    rng = np.random.default_rng(0)
    good = write_clip(tmp_path / "good.mp4", steps(), "mp4v").read_bytes()
    for _ in range(25):
        data = bytearray(good)
        for at in rng.integers(len(good), size=8):
            data[at] = rng.integers(256)
        (tmp_path / "bad.mp4").write_bytes(data)
        with contextlib.suppress(UnreadableImage):
            clip = Clip.open(tmp_path / "bad.mp4")
            assert all(frame.image.shape[1::-1] == clip.size for frame in clip.frames())


MPEG_2 = (".mpg", ".mpeg", ".mpe", ".m2v", ".vob", ".mxf")
ENCODERS = {".webm": "libvpx", ".ogv": "libvpx", ".wmv": "wmv2", ".asf": "wmv2", ".flv": "flv"}
CONTAINERS = {".qt": "mov", ".divx": "avi", ".mpe": "mpeg", ".m2t": "mpegts", ".insv": "mp4", ".360": "mp4"}


@pytest.mark.parametrize("suffix", VIDEO_SUFFIXES)
def test_clips_of_every_container_are_read(tmp_path, suffix):
    codec = "mpeg2video" if suffix in MPEG_2 else ENCODERS.get(suffix, "mpeg4")
    path = tmp_path / f"clip{suffix}"
    with av.open(str(path), "w", format=CONTAINERS.get(suffix)) as container:
        stream = container.add_stream(codec, 25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        for frame in steps():
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "rgb24")))
        container.mux(stream.encode())
    assert is_clip(path)
    clip = Clip.open(path)
    assert (clip.size, clip.frame_rate) == ((96, 64), 25)
    frames = list(clip.frames())
    assert len(frames) == 10
    assert [frame.image.mean() for frame in frames] == pytest.approx([frame.mean() for frame in steps()], abs=5)


def test_videos_are_collected_if_requested(tmp_path, short):
    assert collect_images([short], videos=True) == [short]
    assert collect_images([tmp_path], videos=True) == [short]
    with pytest.raises(ValueError, match=r"found 1 \.avi"):
        collect_images([short])
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((9, 9), np.uint8))
    assert [path.name for path in collect_images([tmp_path], videos=True)] == ["a.png"]
    assert [path.name for path in collect_images([tmp_path, short], videos=True)] == ["a.png", "short.avi"]


def test_video_detection_finds_the_board_and_its_motion(labelled_clip, detections):
    labels = labelled_clip[1]
    assert (str(detections.board), detections.count) == ("9x6", len(labels))
    assert len(detections.frames) == -(-len(labels) // 3)  # eight a second of 24
    still = [frame.motion for frame in detections.found if labels[frame.index] == labels[frame.index - 1] != "moving"]
    moving = [frame.motion for frame in detections.found if labels[frame.index] == "moving"]
    assert max(still) < 0.5
    assert min(moving) > 3
    # Of three consecutive frames, the one that is searched is one without motion, if there is one.
    for i, frame in enumerate(detections.frames):
        three = range(max(3 * i, 1), min(3 * i + 3, len(labels)))
        standing = [labels[k - 1] == labels[k] != "moving" for k in three]
        assert frame.index // 3 == i
        assert labels[frame.index] != "moving" or not any(standing)


def test_number_of_searched_frames_is_bounded_for_any_declared_length(labelled_clip, monkeypatch):
    clip = Clip.open(labelled_clip[0])
    monkeypatch.setattr(clip_detection, "MAX_FRAMES_SEARCHED", 7)
    calls = []
    for declared in (None, 1, clip.declared_frames, 10**8):
        result = detect_in_clip(replace(clip, declared_frames=declared), BOARD, progress=lambda *c: calls.append(c))
        assert 1 <= len(result.frames) <= 7
    assert len(calls) >= 4
    assert all(0 < done <= total for done, total in calls)


def test_corners_of_downsampled_frames_are_in_original_pixels(labelled_clip, detections, monkeypatch):
    monkeypatch.setattr(clip_detection, "MAX_SEARCH_PIXELS", 200_000)
    clip = Clip.open(labelled_clip[0])
    small = detect_in_clip(clip, BOARD)
    exact = {frame.index: frame.boards[0] for frame in detections.found}
    off = [
        np.linalg.norm(
            board.pixels[np.isin(board.ids, known.ids)] - known.pixels[np.isin(known.ids, board.ids)], axis=1
        )
        for frame in small.found
        for board, known in [(frame.boards[0], exact.get(frame.index))]
        if known is not None and labelled_clip[1][frame.index] != "moving"
    ]
    assert len(off) > 15
    assert np.median(np.concatenate(off)) < 0.15


def test_one_frame_without_motion_is_selected_per_pose(labelled_clip):
    path, labels = labelled_clip
    selected = select_frames(path)
    indices = [int(p.stem.rsplit("-")[-1]) for p in selected.paths]
    assert indices == sorted(indices)
    poses = [labels[i] for i in indices]
    assert "moving" not in poses
    assert "empty" not in poses
    assert len(set(poses)) == len(poses) >= POSE_COUNT - 1
    counts = f"{len(labels)} frames, {selected.searched} searched, {selected.found} with a board, {len(poses)} selected"
    assert selected.note == f"clip.avi: {counts}"
    assert POSE_COUNT * (FRAMES_AT_REST + FRAMES_IN_MOTION) / 3 * 0.8 < selected.found <= selected.searched - 3
    gray = read_image(selected.paths[0])
    (frame,) = Clip.open(path).frames({indices[0]})
    assert (gray == to_gray8(frame.image)).all()


def test_a_camera_is_calibrated_from_a_video(labelled_clip):
    selected = select_frames(labelled_clip[0])
    calibration = calibrate(detect_boards(selected.paths, cache=False), model="kannala_brandt")
    assert calibration.rms < 0.2
    assert bearing_error(calibration.camera, SETUP.camera, np.radians(80)) < 0.05


def test_a_second_run_reads_no_frame(labelled_clip, monkeypatch):
    first = select_frames(labelled_clip[0])
    monkeypatch.setattr(Clip, "frames", None)
    assert select_frames(labelled_clip[0]) == first


def test_deleted_frames_are_written_again(labelled_clip, monkeypatch):
    first = select_frames(labelled_clip[0])
    first.paths[1].unlink()
    monkeypatch.setattr(frame_selection, "detect_in_clip", None)
    assert select_frames(labelled_clip[0]) == first
    assert first.paths[1].is_file()


def test_a_truncated_video_is_used_up_to_its_end_with_a_note(labelled_clip, tmp_path):
    data = labelled_clip[0].read_bytes()
    (tmp_path / "cut.avi").write_bytes(data[: len(data) // 2])
    selected = select_frames(tmp_path / "cut.avi", BOARD)
    assert len(selected.paths) >= 3
    assert f"ends after {selected.count} of {len(labelled_clip[1])} frames: is the copy truncated?" in selected.note
    assert 0.4 < selected.count / len(labelled_clip[1]) < 0.6


def test_frames_without_board_are_returned_if_no_frame_shows_it(labelled_clip):
    selected = select_frames(labelled_clip[0], Checkerboard(5, 3))
    assert (len(selected.paths), selected.found) == (3, 0)
    assert selected.note.endswith("0 with a board, 0 selected")
    assert "but one of 9x6" in detect_boards(selected.paths, Checkerboard(5, 3), cache=False).images[0].note


def boards(count=24, noise=0.1):
    """Return a fisheye setup and noisy corners of boards in its field of view."""
    setup, rng = fisheye_setup(960), np.random.default_rng(1)
    corners = [board.corners(setup.camera) for board in setup.boards(count, BOARD)]
    return setup, [pixels + rng.normal(0, noise, pixels.shape) for pixels in corners]


def views_of(pixels, setup):
    return observe([(BOARD.points, p) for p in pixels], setup.camera.size)


def test_of_repeated_poses_the_one_with_least_motion_is_selected():
    setup, pixels = boards(8)
    motion = np.concatenate([np.full(8, 3.0), np.zeros(8), np.full(8, 1.0)])
    selected = select_informative_views(views_of([p + shift for shift in (0, 2, 4) for p in pixels], setup), motion)
    assert sorted(i % 8 for i in selected) == list(range(8))
    assert set(selected) == set(range(8, 16))


def test_a_board_with_wrong_corners_is_not_selected():
    setup, pixels = boards(10)
    pixels[4] = pixels[4] @ [[1, 0.3], [0, 0.8]] + 6 * np.random.default_rng(2).standard_normal((BOARD.size, 2))
    assert 4 not in select_informative_views(views_of(pixels, setup), np.zeros(10))


def test_selected_boards_are_as_informative_as_evenly_spaced_ones():
    setup, pixels = boards(60)
    views = views_of(pixels, setup)
    selected = select_informative_views(views, np.zeros(60))
    assert 20 <= len(selected) <= 40

    def predicted_error(indices):
        return predicted_bearing_error(views.subset(indices), setup)

    evenly = np.linspace(0, 59, len(selected)).round().astype(int)
    assert predicted_error(selected) < 1.2 * predicted_error(evenly)


def predicted_bearing_error(views, setup):
    """Return the standard deviation of projected points that follows from the covariance of the parameters, px."""
    from omnisight.calibration.frame_information import view_information
    from omnisight.calibration.resection import resect

    state = resect(setup.camera.model, views)
    covariance = np.linalg.inv(view_information(state, views).sum(0))
    theta, phi = np.meshgrid(np.radians(np.arange(5, 90, 5)), np.radians(np.arange(0, 360, 30)))
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    free = [p.free for p in setup.camera.model.parameters]
    by = setup.camera.model.project_with_jacobians(rays)[3][..., free]
    return float(np.sqrt(np.einsum("nij,jk,nik->n", by, covariance, by).mean()))
