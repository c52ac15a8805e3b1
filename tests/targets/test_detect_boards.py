import json

import cv2
import numpy as np
import pytest

from drawn import POSES, shot
from jpegs import jpeg
from omnisight.images import write_image
from omnisight.targets import Checkerboard, detect_boards, raw_detections

BOARD = Checkerboard(9, 6)


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("OMNISIGHT_CACHE", str(folder))
    return folder


@pytest.fixture(scope="module")
def gray():
    return shot(POSES[1])[0]


def test_unreadable_files_are_skipped_with_the_reason(tmp_path, gray):
    write_image(tmp_path / "a.png", gray)
    (tmp_path / "b.jpg").write_bytes(jpeg(gray)[:-100])
    (tmp_path / "c.jpg").write_bytes(b"")
    write_image(tmp_path / "d.png", np.zeros_like(gray))
    names = ["a.png", "b.jpg", "c.jpg", "d.png", "e.png"]
    done = []
    found = detect_boards([tmp_path / n for n in names], BOARD, progress=lambda *state: done.append(state))
    assert found.board is BOARD
    found = found.images
    assert [p.path.name for p in found] == names
    assert [p.note for p in found] == [
        "",
        "truncated JPEG (no end-of-image marker)",
        "empty file",
        "no 9x6 board detected",
        "no such file or folder",
    ]
    assert [p.detection is not None for p in found] == [True, False, False, False, False]
    assert [p.size for p in found] == [(640, 480), None, None, (640, 480), None]
    assert found[0].sharpness > 0
    assert done == [(i, 5) for i in range(1, 6)]


def test_most_common_size_is_used_and_other_images_are_named(tmp_path, gray):
    for name, image in [
        ("a.png", gray),
        ("b.png", np.roll(gray, 40, 1)),
        ("small.png", gray[::2, ::2]),
        ("portrait.png", np.rot90(gray)),
        *((f"empty{i}.png", np.zeros((300, 500), np.uint8)) for i in range(3)),
    ]:
        write_image(tmp_path / name, np.ascontiguousarray(image))
    names = ["small.png", "a.png", "portrait.png", "b.png", "empty0.png", "empty1.png", "empty2.png"]
    search = detect_boards([tmp_path / n for n in names], BOARD)
    assert search.size == (640, 480)
    assert [p.path.name for p in search.found] == ["a.png", "b.png"]
    assert [p.size is None for p in search.images] == [True, False, True, False, True, True, True]
    assert search.field is not None
    assert search.field.size == (640, 480)
    (note,) = search.notes
    assert note.startswith("images have 4 sizes: 2 of 640x480, which are used; 3 of 500x300 (empty0.png, ")
    assert "1 of 320x240 (small.png); 1 of 480x640 (portrait.png), rotated by 90°?" in note
    assert "320x240 is half of 640x480: resize them" in note
    assert search.images[0].note.startswith("320x240 where others have 640x480: left out; half of 640x480")


def test_exif_rotation_is_noted_once_and_applied_on_request(tmp_path, gray):
    for name, shift in (("a.jpg", 0), ("b.jpg", 40)):
        (tmp_path / name).write_bytes(jpeg(np.roll(gray, shift, 1), orientation=6))
    paths = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    found = detect_boards(paths, BOARD).images
    assert [p.size for p in found] == [(640, 480)] * 2
    assert "EXIF orientation 6 ignored" in found[0].note
    assert found[1].note == ""
    turned = detect_boards(paths, BOARD, apply_exif=True).images
    assert [p.size for p in turned] == [(480, 640)] * 2
    assert [p.note for p in turned] == ["", ""]


@pytest.mark.parametrize("of_clip", [False, True])
def test_the_video_is_proposed_in_place_of_repeated_images_unless_they_are_its_frames(
    tmp_path, gray, monkeypatch, of_clip
):
    monkeypatch.setattr("omnisight.targets.set_checks.frames_folder", lambda: tmp_path if of_clip else tmp_path / "no")
    (tmp_path / "clip").mkdir()
    paths = [tmp_path / "clip" / f"board-{k:06d}.png" for k in range(2)]
    for path in paths:
        write_image(path, gray)
    (note,) = detect_boards(paths, BOARD).notes
    assert "1 of 2 images with a board repeats another one" in note
    assert note.endswith("move and tilt the board between images") is of_clip
    assert ("or use the video itself" in note) is not of_clip


def test_second_run_uses_the_cache(tmp_path, gray, cache_folder, monkeypatch):
    write_image(tmp_path / "a.png", gray)
    (first,) = detect_boards([tmp_path / "a.png"], BOARD).images
    (tmp_path / "a.png").rename(tmp_path / "renamed.png")
    monkeypatch.setattr(raw_detections, "find_grids", None)
    (second,) = detect_boards([tmp_path / "renamed.png"], BOARD).images
    for name in ("pixels", "covariance", "ids"):
        np.testing.assert_array_equal(getattr(first.detection, name), getattr(second.detection, name))
    assert (first.sharpness, first.exposure, first.blur) == (second.sharpness, second.exposure, second.blur)
    # What an image shows does not depend on the board that is asked for.
    assert detect_boards([tmp_path / "renamed.png"], Checkerboard(8, 6)).images[0].note.endswith("but one of 9x6")
    with pytest.raises(TypeError):
        detect_boards([tmp_path / "renamed.png"], BOARD, cache=False)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe",
        b"[1]",
        b"{}",
        json.dumps({"size": [640, 480], "grids": [{}], "boards": [], "sharpness": 1, "exposure": 1}),
        json.dumps({"size": [640, 480], "grids": [], "boards": [{"ids": [1]}], "sharpness": 1, "exposure": 1}),
        "[" * 100_000,
    ],
)
def test_damaged_cache_entry_is_ignored(tmp_path, gray, cache_folder, content):
    write_image(tmp_path / "a.png", gray)
    detect_boards([tmp_path / "a.png"], BOARD)
    entries = list(cache_folder.rglob("*.json"))  # of the image, and of what the lens shows
    for entry in entries:
        entry.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert len(detect_boards([tmp_path / "a.png"], BOARD).images[0].detection) == BOARD.size
    assert [json.loads(entry.read_bytes())["size"] for entry in entries] == [[640, 480]] * 2


def test_unwritable_cache_is_no_error(tmp_path, gray, monkeypatch):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("OMNISIGHT_CACHE", str(tmp_path / "file"))
    write_image(tmp_path / "a.png", gray)
    assert detect_boards([tmp_path / "a.png"], BOARD).images[0].detection is not None


def test_miscounted_pattern_gives_a_hint_with_the_right_one(tmp_path, gray):
    for name in ("a.png", "b.png"):
        write_image(tmp_path / name, cv2.convertScaleAbs(gray, alpha=0.9 if name == "a.png" else 1.0))
    write_image(tmp_path / "c.png", np.zeros_like(gray))
    paths = [tmp_path / n for n in ("a.png", "b.png", "c.png")]
    found = detect_boards(paths, Checkerboard(8, 6))
    assert found.images[0].note == "no 8x6 board detected, but one of 9x6"
    assert found.hint == (
        "found a grid of 9x6 inner corners (10x7 squares) in 2/3 images, but the requested board is 8x6 (9x7 squares)."
        " Use --pattern 9x6 or --squares 10x7."
    )
    assert detect_boards(paths, BOARD).hint is None
    inferred = detect_boards(paths, square=0.03)
    assert inferred.board == Checkerboard(9, 6, 0.03)
    assert all(d.board == inferred.board for p in inferred.found for d in p.boards)
    assert len(inferred.found) == 2


@pytest.mark.parametrize(("pattern", "noted"), [((6, 9), True), ((9, 6), False), (None, False)])
def test_a_pattern_with_columns_and_rows_exchanged_is_noted(tmp_path, gray, pattern, noted):
    write_image(tmp_path / "a.png", gray)
    board = None if pattern is None else Checkerboard(*pattern)
    detections = detect_boards([tmp_path / "a.png"], board, cache=False)
    assert len(detections.images[0].boards[0]) == 54
    assert any("the 6x9 board is a 9x6 board rotated by 90°" in note for note in detections.notes) == noted
