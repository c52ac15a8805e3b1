"""Boards with markers in images for which no board is specified."""

import cv2
import numpy as np
import pytest

import omnisight as om
from drawn import POSES, shot
from omnisight.images import write_image
from omnisight.targets import detect_boards
from omnisight.targets.boards import board_class
from omnisight.targets.boards.aprilgrid import AprilGrid
from omnisight.targets.boards.charuco import Charuco
from omnisight.targets.boards.symmetric_circles import SymmetricCircles
from omnisight.targets.detectors.markers.recognition import recognize_markers
from prints import APRIL, ARUCO_GRID, CHARUCO, CIRCLES, pose, render

DISCS = SymmetricCircles(7, 5, spacing=0.028, diameter=0.016)
BOARDS = [
    (CHARUCO, "DICT_5X5_50"),
    (Charuco(6, 6, square=0.024, marker=0.016, dictionary="DICT_4X4_250"), "DICT_4X4_50"),
    (Charuco(8, 5, square=0.024, marker=0.018, dictionary="DICT_6X6_250", legacy=True), "DICT_6X6_50"),
    (APRIL, "DICT_APRILTAG_36h11"),
    (AprilGrid(4, 5, tag=0.024, spacing=0.2), "DICT_APRILTAG_36h11"),
    (ARUCO_GRID, "DICT_6X6_50"),
]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("board", "dictionary"), BOARDS)
def test_kind_size_and_dictionary_are_recognized(board, dictionary, mirrored):
    image, _ = render(board, "fisheye", pose(board, 20, roll=70), mirrored=mirrored)
    found = recognize_markers([np.full((480, 640), 128, np.uint8), image])
    assert (found.kind, found.columns, found.rows) == (board.kind, board.columns, board.rows)
    assert found.dictionary == dictionary


def test_charuco_printed_white_on_black_is_recognized():
    found = recognize_markers([255 - render(CHARUCO, "fisheye", pose(CHARUCO, 20))[0]])
    assert (found.kind, found.columns, found.rows) == ("charuco", 9, 6)


def test_a_grid_of_markers_is_recognized():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    board = cv2.aruco.GridBoard((5, 7), 0.04, 0.01, dictionary)
    found = recognize_markers([np.asarray(board.generateImage((600, 840), marginSize=40))])
    assert (found.kind, found.columns, found.rows, found.dictionary) == ("aruco_grid", 5, 7, "DICT_6X6_50")


def test_a_checkerboard_and_noise_are_no_markers():
    noise = np.random.default_rng(0).integers(0, 256, (300, 400), dtype=np.uint8)
    assert recognize_markers([shot(POSES[0])[0], noise]) is None


@pytest.mark.parametrize(
    ("board", "unit"),
    [
        (CHARUCO, "square"),
        (AprilGrid(4, 5, tag=0.024, spacing=0.2), "tag"),
        (APRIL, "tag"),
        (ARUCO_GRID, "marker"),
        (CIRCLES, "spacing"),
        (DISCS, "spacing"),
    ],
    ids=lambda value: getattr(value, "kind", None),
)
def test_unspecified_boards_are_used_with_lengths_relative_to_one(tmp_path, board, unit):
    paths = [tmp_path / f"{i}.png" for i in range(3)]
    for i, path in enumerate(paths):
        write_image(path, render(board, "fisheye", pose(board, 10, roll=50 * i))[0])
    found = detect_boards(paths, cache=False)
    assert (found.board.kind, found.board.size, found.board.unit) == (board.kind, board.size, "squares")
    truth = {name: length / getattr(board, unit) for name, length in board.lengths().items()}
    assert found.board.lengths() == pytest.approx(truth, rel=0.2)
    np.testing.assert_allclose(
        found.board.points * getattr(board, unit), board.points, atol=0.02 * getattr(board, unit)
    )
    assert len(found.found) == 3
    assert found.assumption.startswith(f"{board.kind} {board}, recognized: ")
    assert f"lengths in {unit}s" in found.assumption
    assert board_class(board.kind).from_dict(found.board.to_dict()) == found.board


def test_a_grid_of_separate_markers_of_opencv_is_used(tmp_path):
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    board = cv2.aruco.GridBoard((5, 7), 0.04, 0.01, dictionary)
    write_image(tmp_path / "a.png", np.asarray(board.generateImage((600, 840), marginSize=40)))
    found = detect_boards([tmp_path / "a.png"], cache=False)
    assert (found.board.kind, found.board.columns, found.board.rows) == ("aruco_grid", 5, 7)
    assert found.board.separation == pytest.approx(0.25, abs=0.03)  # OpenCV rounds the markers' sides to pixels
    assert len(found.images[0].detection) == found.board.size


def test_square_is_the_scale_of_an_unspecified_board(tmp_path):
    write_image(tmp_path / "a.png", render(CHARUCO, "fisheye", pose(CHARUCO, 10))[0])
    found = detect_boards([tmp_path / "a.png"], square=0.024, cache=False)
    assert (found.board.square, found.board.unit) == (0.024, "m")
    assert "square 24mm" in found.assumption


def test_markers_are_not_searched_where_checkerboards_are_complete(tmp_path, monkeypatch):
    def fail(grays):
        raise AssertionError("markers searched")

    monkeypatch.setattr("omnisight.targets.unspecified_board.recognize_markers", fail)
    for i in range(3):
        write_image(tmp_path / f"{i}.png", shot(POSES[i])[0])
    paths = sorted(tmp_path.glob("*.png"))
    assert len(detect_boards(paths, cache=False).found) == 3
    blank = tmp_path / "blank.png"
    write_image(blank, np.full((480, 640), 128, np.uint8))
    with pytest.raises(AssertionError, match="markers searched"):
        detect_boards([blank], cache=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "board", "rms"),
    [
        ("charuco_phone", "charuco 8x6", 0.35),
        ("circles_asymmetric", "circles 4x11", 0.55),
        ("aruco_grid", "aruco_grid 6x4", 0.6),
    ],
)
def test_real_boards_are_recognized_and_calibrate(data, name, board, rms):
    calibration = om.calibrate(data("everyday") / name)
    detections = calibration.observations.detections
    assert detections.assumption.startswith(board)
    assert len(detections.found) == len(detections.images)
    assert calibration.rms < rms
