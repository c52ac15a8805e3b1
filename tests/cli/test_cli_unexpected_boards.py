"""Boards that differ from their description: layout, swapped columns and rows, a mirror."""

import json

import cv2
import numpy as np
import pytest
from cli_scene import QUICK

from drawn import POSES, scene
from drawn import pose as drawn_pose
from omnisight.images import read_image, write_image
from omnisight.targets import Checkerboard
from omnisight.targets.boards.charuco import Charuco
from prints import pose, render

BOARD = Charuco(8, 5, square=0.024, marker=0.018)


@pytest.fixture(scope="module")
def charucos(tmp_path_factory):
    """Three images of a ChArUco board."""
    folder = tmp_path_factory.mktemp("charucos")
    for i, angle in enumerate((10, 40, 60)):
        write_image(folder / f"{i}.png", render(BOARD, "fisheye", pose(BOARD, angle, azimuth=100 * i), seed=i)[0])
    return folder


@pytest.fixture
def target(tmp_path):
    def write(**changes):
        board = {"target": "charuco", "columns": 8, "rows": 5, "square": "24mm", "marker": "18mm", **changes}
        path = tmp_path / "board.json"
        path.write_text(json.dumps(board))
        return path

    return write


def detect(run, folder, target):
    status, out, err = run("detect", folder, "--target", target, "--json")
    assert (status, err) == (0, "")
    return json.loads(out)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"legacy": True}, "the print has the layout of OpenCV since 4.6 (legacy: false)"),
        ({"columns": 5, "rows": 8}, "the print has columns and rows swapped (8x5)"),
    ],
    ids=["charuco legacy layout", "swapped rows and columns of a charuco"],
)
def test_another_charuco_layout_is_detected_and_noted(run, charucos, target, changes, message):
    result = detect(run, charucos, target(**changes))
    assert len(result["images"]) == 3
    for image in result["images"]:
        assert len(image["boards"][0]["ids"]) > 30
        assert image["note"].endswith(message)
    assert result["notes"] == []


def test_mirrored_charuco_is_noted(run, charucos, target, tmp_path):
    for path in charucos.iterdir():
        write_image(tmp_path / path.name, np.ascontiguousarray(read_image(path)[:, ::-1]))
    result = detect(run, tmp_path / "*.png", target())
    assert result["notes"] == [
        "the markers match only when mirrored in all images with a board (0.png, 1.png, 2.png): is a webcam's mirror"
        " mode on? Turn it off; only a camera that looks into a mirror sees the board like that"
    ]
    assert min(len(image["boards"][0]["ids"]) for image in result["images"]) > 30
    write_image(tmp_path / "0.png", read_image(charucos / "0.png"))
    (note,) = detect(run, tmp_path / "*.png", target())["notes"]
    assert note.startswith("the markers match only when mirrored in 2 of 3 images with a board (1.png, 2.png)")


def test_missing_board_with_markers_is_reported_with_its_fields(refuses, charucos, target):
    message = refuses("calibrate", charucos, "--target", target(dictionary="DICT_4X4_50"))
    assert "8x5 charuco detected in 0 of 3 images: is it really this charuco" in message
    assert "dictionary DICT_4X4_50" in message
    assert "0.png: no 8x5 board detected" in message


def test_counted_squares_give_a_hint_with_the_right_pattern(run, shots, tmp_path):
    status, out, _ = run("detect", shots, "--pattern", "10x7", "-o", tmp_path / "drawn")
    assert status == 0
    assert "found a grid of 9x6 inner corners (10x7 squares) in 6/6 images, but the requested board is 10x7" in out
    assert "(11x8 squares). Use --pattern 9x6 or --squares 10x7." in out


def test_images_of_another_board_may_be_dropped(run, refuses, tmp_path):
    boards = [Checkerboard(9, 6)] * 3 + [Checkerboard(8, 5)] * 4
    for i, (board, placed) in enumerate(zip(boards, [*POSES, (10, 20, 30, 8)], strict=True)):
        write_image(tmp_path / f"{i}.png", scene((board, drawn_pose(board, *placed), True)))
    drops = [word for i in range(3, 7) for word in ("--drop", f"{i}.png")]
    assert "found a grid of 8x5 inner corners" in refuses("calibrate", tmp_path, *QUICK, *drops[:2], "--drop", "0.png")
    status, _, err = run("calibrate", tmp_path, *QUICK, *drops)
    assert (status, err) == (0, "")


def test_swapped_rows_and_columns_give_the_same_corners(run, shots):
    straight, swapped = (
        json.loads(run("detect", shots, "--pattern", pattern, "--json")[1]) for pattern in ("9x6", "6x9")
    )
    assert len(straight["images"]) == 6
    for one, other in zip(straight["images"], swapped["images"], strict=True):
        pixels = [np.array(p["boards"][0]["pixels"]) for p in (one, other)]
        assert np.array_equal(*(p[np.lexsort(p.T)] for p in pixels))


def test_mirrored_checkerboard_gives_no_note(run, shots, tmp_path):
    for i in (1, 2):
        write_image(tmp_path / f"{i}.png", cv2.flip(read_image(shots / f"{i}.png"), 1))
    message = json.loads(run("detect", tmp_path / "*.png", "--pattern", "9x6", "--json")[1])
    assert message["notes"] == []
    assert [len(image["boards"]) for image in message["images"]] == [1, 1]
