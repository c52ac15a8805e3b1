"""Checkerboards in images of fisheyes and mirrors: corners, their order, and patterns."""

from pathlib import Path

import numpy as np
import pytest

from drawn import POSES, SIZE, shot
from omnisight.images import collect_images
from omnisight.targets import Checkerboard, Detection, detect_boards, detect_checkerboard, parse_length
from omnisight.targets.detectors.checkerboard.grid_search import find_grids
from pace import assert_quick

REAL = [
    # folder, pattern of names, board, corners to compare with, least boards, least corners
    ("fisheye1_urban", "*.jpg", "8x6", "fish1", 15, 720),
    ("kaidan_catadioptric", "*.jpg", "11x7", "kaidan", 17, 1295),
    ("mei_paracatadioptric", "*.png", "8x6", "mei", 10, 468),
    ("camodocal_fisheye", "*.png", "9x6", "camo", 21, 1125),
    ("stereo_fisheye_sourishg", "left*", "9x6", "fstereo_left", 20, 1080),
    ("stereo_fisheye_sourishg", "right*", "9x6", "fstereo_right", 20, 1080),
    ("ai360_lens_a", "*.jpg", "11x8", "ai360_a", 5, 440),
    ("gopro_derlunz_static_board", "*.JPG", "15x9", "derlunz", 24, 3230),
]


@pytest.mark.parametrize("view", POSES)
def test_corners_in_a_fisheye_image_match_the_truth(view):
    board = Checkerboard(9, 6)
    image, truth = shot(view)
    found = detect_checkerboard(image, board)
    assert found is not None
    assert len(found) >= 52
    # 9 + 6 is odd, so the colours fix which corner is which.
    error = np.linalg.norm(found.pixels - truth[found.ids], axis=1)
    assert np.sqrt((error**2).mean()) < 0.1
    assert error.max() < 0.35


@pytest.mark.parametrize("board", [Checkerboard(8, 6), Checkerboard(7, 7), Checkerboard(9, 6)])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("roll", [0, 100, 200, 290])
def test_corner_order_has_the_same_handedness_in_every_image(board, mirrored, roll):
    image, truth = shot((20, 10, roll, 7), board.columns, board.rows)
    if mirrored:
        image, truth = image[:, ::-1], np.stack([SIZE[0] - 1 - truth[:, 0], truth[:, 1]], axis=1)
    found = detect_checkerboard(image, board)
    assert found is not None
    assert len(found) == board.size
    grid = found.pixels.reshape(board.rows, board.columns, 2)
    column, row = grid[:-1, 1:] - grid[:-1, :-1], grid[1:, :-1] - grid[:-1, :-1]
    assert (column[..., 0] * row[..., 1] - column[..., 1] * row[..., 0] > 0).all()
    # The same set of corners as the truth, only ordered anew.
    nearest = np.linalg.norm(found.pixels[:, None] - truth, axis=2).min(axis=1)
    assert nearest.max() < 0.35


def test_swapped_pattern_gives_the_same_corners_in_its_own_order():
    board = Checkerboard(9, 6)
    image, _ = shot(POSES[1])
    as_given, swapped = detect_checkerboard(image, board), detect_checkerboard(image, Checkerboard(6, 9))
    assert len(swapped) == 54
    assert {tuple(p) for p in np.round(as_given.pixels, 3)} == {tuple(p) for p in np.round(swapped.pixels, 3)}


@pytest.mark.parametrize("asked", [(8, 6), (9, 5), (8, 5), (10, 6), (10, 7)])
def test_another_board_is_rejected_and_its_pattern_is_reported(asked):
    image, _ = shot(POSES[0])
    assert detect_checkerboard(image, Checkerboard(*asked)) is None
    assert [sorted(grid.shape) for grid in find_grids(image)] == [[6, 9]]


def test_covered_corners_are_left_out():
    board = Checkerboard(9, 6)
    image, truth = shot(POSES[1])
    image = image.copy()
    u, v = truth[20].astype(int)
    image[v - 18 : v + 19, u - 18 : u + 19] = 120
    found = detect_checkerboard(image, board)
    assert found is not None
    assert 20 not in found.ids
    assert len(found) >= 48
    assert np.linalg.norm(found.pixels - truth[found.ids], axis=1).max() < 0.4


@pytest.mark.parametrize("kind", ["black", "white", "noise", "ramp", "tiny", "empty"])
def test_images_without_a_board_give_no_detection_quickly(kind):
    size = {"tiny": (3, 5), "empty": (0, 0)}.get(kind, (3000, 4000))
    image = {
        "noise": lambda: np.random.default_rng(0).integers(0, 256, size, dtype=np.uint8),
        "ramp": lambda: np.broadcast_to(np.linspace(0, 255, size[1]).astype(np.uint8), size),
    }.get(kind, lambda: np.full(size, 255 if kind == "white" else 0, np.uint8))()
    found = []
    assert_quick(lambda: found.append(detect_checkerboard(image, Checkerboard(9, 6))), 40)  # they take 7
    assert found[-1] is None


def test_color_image_raises():
    with pytest.raises(ValueError, match=r"expected a gray image .* got shape \(40, 40, 3\) of uint8"):
        detect_checkerboard(np.zeros((40, 40, 3), np.uint8), Checkerboard(9, 6))


@pytest.mark.parametrize("pattern", ["8x6", "8,6", "8X6", " 8 x 6 ", "8×6"])
def test_pattern_accepts_common_notations(pattern):
    board = Checkerboard.parse(pattern, square="32.5mm")
    assert (board.columns, board.rows, board.unit) == (8, 6, "m")
    assert board.square == pytest.approx(0.0325)
    assert str(board) == "8x6"


@pytest.mark.parametrize(("text", "metres"), [("30mm", 0.03), ("3 cm", 0.03), (".03m", 0.03), ("1in", 0.0254)])
def test_length_is_parsed_to_metres(text, metres):
    assert parse_length(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    ("pattern", "square", "message"),
    [
        ("8", None, "cannot read the pattern '8'"),
        ("8x", None, "COLUMNSxROWS"),
        ("2x6", None, "3x3 inner corners or more, got 2x6"),
        ("8x6", "30", "has no unit: write 30mm"),
        ("8x6", "30 parsec", "unknown unit 'parsec'"),
        ("8x6", "0mm", "must be positive"),
        ("8x6", "wide", "cannot read the length 'wide'"),
    ],
)
def test_unreadable_pattern_raises_with_the_reason(pattern, square, message):
    with pytest.raises(ValueError, match=message):
        Checkerboard.parse(pattern, square)


def test_points_run_along_columns_first():
    points = Checkerboard(4, 3, 0.5).points
    np.testing.assert_array_equal(points[[0, 1, 4, 11]], [[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [1.5, 1, 0]])
    assert Checkerboard(8, 6).is_symmetric
    assert not Checkerboard(9, 6).is_symmetric


def test_detection_checks_its_shapes():
    with pytest.raises(ValueError, match=r"shapes \(2,\), \(3, 2\) and \(3, 2, 2\)"):
        Detection(np.arange(2), np.zeros((3, 2)), np.zeros((3, 2, 2)))


@pytest.mark.slow
@pytest.mark.usefixtures("fresh_detections")
@pytest.mark.parametrize(("folder", "names", "pattern", "corners", "boards", "points"), REAL)
def test_real_boards_are_detected(data, folder, names, pattern, corners, boards, points):
    board = Checkerboard.parse(pattern)
    given = np.load(data("corners") / f"{corners}.npz")
    given = {Path(str(f)).stem: c for f, c in zip(given["files"], given["corners"], strict=True)}
    found = detect_boards(collect_images([str(data(folder) / names)]), board).found
    apart = [
        np.median(np.linalg.norm(given[p.path.stem][:, None] - p.detection.pixels, axis=2).min(axis=0))
        for p in found
        if p.path.stem in given
    ]
    assert len(found) >= boards
    assert sum(len(p.detection) for p in found) >= points
    # OpenCV's corners hold gross errors, and small windows bias them where black bleeds out: medians only.
    assert np.median(apart) < 0.5
