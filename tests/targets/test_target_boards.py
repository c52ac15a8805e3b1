"""Laws of every kind of board, and prints that OpenCV's own detectors read."""

import itertools

import cv2
import numpy as np
import pytest
from example_boards import BOARDS, EXAMPLES, SCALE, aprilgrid, charuco, checkerboard, circles, rasterise

from omnisight.targets.boards import board_class, board_kinds
from omnisight.targets.boards._aruco import cell_shapes
from omnisight.targets.printing.drawing import Disc, translated


def printed(board):
    """Return an image of the board with its white margin, and where its points are in it (N, 2), px."""
    left, top, right, bottom = board.extent
    x, y = board.quiet_zone * 1.5 - left, board.quiet_zone * 1.5 - top
    image = rasterise(
        [translated(shape, x, y) for shape in board.drawing()],
        right - left + 3 * board.quiet_zone,
        bottom - top + 3 * board.quiet_zone,
    )
    return image, (board.points[:, :2] + (x, y)) * SCALE - 0.5


def test_every_kind_has_examples():
    assert set(EXAMPLES) == set(board_kinds())


def test_unknown_kind_raises_with_the_known_kinds():
    with pytest.raises(ValueError, match="unknown kind of target 'dots'; there are: aprilgrid, aruco_grid, charuco"):
        board_class("dots")


@pytest.mark.parametrize("board", BOARDS)
def test_board_round_trips_through_its_dictionary(board):
    values = board.to_dict()
    assert values["target"] == board.kind
    assert type(board).from_dict(values) == board
    assert all(value.endswith("mm") for name, value in values.items() if name in board.lengths())


def test_length_round_trips_through_millimetres():
    for tenths in range(1, 2000):
        board = checkerboard(9, 6, tenths / 10000)
        assert checkerboard.from_dict(board.to_dict()) == board


@pytest.mark.parametrize("board", BOARDS)
def test_points_lie_in_a_plane_within_the_ink(board):
    points = board.points
    assert points.shape == (board.size, 3)
    assert board.unit == "m"
    assert not points[:, 2].any()
    left, top, right, bottom = board.extent
    assert (points[:, :2] >= (left - 1e-9, top - 1e-9)).all()
    assert (points[:, :2] <= (right + 1e-9, bottom + 1e-9)).all()
    assert len(np.unique(points.round(9), axis=0)) == board.size


@pytest.mark.parametrize("board", BOARDS)
def test_drawing_fills_the_extent_exactly(board):
    boxes = []
    for shape in board.drawing():
        corners = np.array(shape.corners if not isinstance(shape, Disc) else shape.centre).reshape(-1, 2)
        reach = shape.radius if isinstance(shape, Disc) else 0
        boxes.append([*(corners.min(axis=0) - reach), *(corners.max(axis=0) + reach)])
    boxes = np.array(boxes)
    drawn = [*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)]
    assert drawn == pytest.approx(board.extent, abs=1e-12)


@pytest.mark.parametrize("board", BOARDS)
def test_symmetric_board_looks_the_same_after_a_rotation(board):
    image = printed(board)[0].astype(float)
    same = [
        (np.abs(np.rot90(image, turns) - image) > 200).mean() < 1e-3
        for turns in (1, 2, 3)
        if turns == 2 or image.shape[0] == image.shape[1]
    ]
    assert any(same) is board.is_symmetric


@pytest.mark.parametrize("board", EXAMPLES["checkerboard"][:2], ids=str)
def test_opencv_detects_the_checkerboard(board):
    image, expected = printed(board)
    done, found = cv2.findChessboardCorners(image, (board.columns, board.rows))
    assert done
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    found = cv2.cornerSubPix(image, found, (5, 5), (-1, -1), stop).reshape(-1, 2)
    off = min(np.linalg.norm(found[::step] - expected, axis=1).max() for step in (1, -1))
    assert off < 0.1


@pytest.mark.parametrize("board", EXAMPLES["charuco"], ids=str)
def test_opencv_detects_the_charuco(board):
    image, expected = printed(board)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    theirs = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), board.square, board.marker, dictionary)
    theirs.setLegacyPattern(board.legacy)
    corners, ids, _, markers = cv2.aruco.CharucoDetector(theirs).detectBoard(image)
    assert sorted(ids.ravel()) == list(range(board.size))
    assert sorted(markers.ravel()) == list(range(len(board.marker_squares)))
    assert np.linalg.norm(corners.reshape(-1, 2) - expected[ids.ravel()], axis=1).max() < 0.3
    # OpenCV counts from the corner of the first square, we from the first inner corner.
    ours = board.points + np.array([board.square, board.square, 0])
    np.testing.assert_allclose(np.array(theirs.getChessboardCorners()), ours, atol=1e-6)


def test_charuco_layouts_differ_only_for_an_even_number_of_squares_down():
    for rows in (5, 6):
        new, old = (charuco(6, rows, 0.03, 0.02, legacy=legacy).marker_squares for legacy in (False, True))
        assert (new == old) is (rows == 6)


@pytest.mark.parametrize("board", EXAMPLES["aprilgrid"], ids=str)
def test_opencv_detects_the_aprilgrid(board):
    image, expected = printed(board)
    options = cv2.aruco.DetectorParameters()
    options.markerBorderBits = 2
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    found, ids, _ = cv2.aruco.ArucoDetector(family, options).detectMarkers(image)
    assert sorted(ids.ravel()) == list(range(board.columns * board.rows))
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    for corners, tag in zip(found, ids.ravel(), strict=True):
        assert np.linalg.norm(corners[0] - expected[board.corners[tag]], axis=1).max() < 3
        # Where tag and gap meet is a saddle, which OpenCV's refinement of tags does not use.
        saddles = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), (4, 4), (-1, -1), stop)
        assert np.linalg.norm(saddles[:, 0] - expected[board.corners[tag]], axis=1).max() < 0.2


@pytest.mark.parametrize("board", EXAMPLES["aruco_grid"], ids=str)
def test_opencv_detects_the_aruco_grid_and_numbers_its_points_alike(board):
    image, expected = printed(board)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    assert sorted(ids.ravel()) == list(range(board.columns * board.rows))
    for corners, marker in zip(found, ids.ravel(), strict=True):
        assert np.linalg.norm(corners[0] - expected[4 * marker : 4 * marker + 4], axis=1).max() < 1.5
    theirs = cv2.aruco.GridBoard((board.columns, board.rows), board.marker, board.separation, dictionary)
    np.testing.assert_allclose(board.points, np.array(theirs.getObjPoints()).reshape(-1, 3), atol=1e-6)


def test_aprilgrid_is_numbered_and_drawn_like_kalibr():
    board = aprilgrid(3, 2, 0.1, 0.3)
    # Kalibr's createGridPoints, with y up.
    kalibr = [(c // 2 * 1.3 * 0.1 + c % 2 * 0.1, r // 2 * 1.3 * 0.1 + r % 2 * 0.1) for r in range(4) for c in range(6)]
    np.testing.assert_allclose(board.points[:, :2] * (1, -1), kalibr, atol=1e-12)
    # Kalibr's codes of tags 0 to 2: bit after bit along the rows, from the top left of the print.
    image, expected = printed(board)
    for tag, code in enumerate((0xD5D628584, 0xD97F18B49, 0xDD280910E)):
        bottom_left = expected[board.corners[tag][1]]
        cell = board.tag / 10 * SCALE
        bits = ""
        for row, column in itertools.product(range(6), range(6)):
            u, v = bottom_left + np.array([2.5 + column, row - 7.5]) * cell
            bits += "01"[int(image[round(v), round(u)] > 127)]
        assert int(bits, 2) == code


@pytest.mark.parametrize("board", EXAMPLES["circles"], ids=str)
def test_opencv_detects_the_circles(board):
    image, expected = printed(board)
    found = cv2.findCirclesGrid(image, (board.columns, board.rows), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
    assert found[0]
    distances = np.linalg.norm(found[1].reshape(-1, 1, 2) - expected, axis=2)
    assert distances.min(axis=1).max() < 0.1
    # With an even number of rows the order is OpenCV's guess, and not even row by row.
    if not board.is_symmetric:
        assert list(distances.argmin(axis=1)) == list(range(board.size))


def test_marker_shapes_reproduce_its_cells_even_nested_ones():
    rng = np.random.default_rng(0)
    for density in (0.3, 0.5, 0.7, 0.9):
        cells = np.pad(rng.random((9, 9)) < density, 1)
        image = rasterise(cell_shapes(cells, 0.0, 0.0, 0.11), 0.11, 0.11, scale=1100)
        middles = image[5::11, 5::11] > 127
        np.testing.assert_array_equal(middles, cells)


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        ("checkerboard", {"columns": 9}, "the target checkerboard needs rows"),
        (
            "checkerboard",
            {"columns": 9, "rows": 6, "tag": "3mm"},
            "the target checkerboard has no 'tag'; it has columns, rows, square",
        ),
        ("checkerboard", {"columns": 9, "rows": 6, "square": "30"}, "square: the length '30' has no unit: write 30mm"),
        ("checkerboard", {"columns": 9, "rows": 6, "square": 30}, "square is 30: expected a length in quotes"),
        ("checkerboard", {"columns": 9.5, "rows": 6}, "columns is 9.5: expected an integer"),
        ("checkerboard", {"columns": True, "rows": 6}, "columns is True: expected an integer"),
        ("checkerboard", {"columns": "9", "rows": 6}, "columns is '9': expected an integer"),
        ("checkerboard", {"columns": 10**7, "rows": 6}, "columns is 10000000: expected an integer from 1 to 1000"),
        (
            "checkerboard",
            {"target": "charuco", "columns": 9, "rows": 6},
            "target is 'charuco': expected 'checkerboard'",
        ),
        ("charuco", {"columns": 9, "rows": 6, "square": "30mm"}, "the target charuco needs marker"),
        ("charuco", {"columns": 9, "rows": 6, "square": "3cm", "marker": "4cm"}, "must be smaller than its square"),
        ("charuco", {"columns": 1, "rows": 6, "square": "3cm", "marker": "1cm"}, "needs 2x2 inner corners or more"),
        (
            "charuco",
            {"columns": 9, "rows": 6, "square": "3cm", "marker": "2cm", "dictionary": "__doc__"},
            "unknown dictionary of markers '__doc__'; use one of OpenCV's, such as DICT_5X5_100",
        ),
        (
            "charuco",
            {"columns": 19, "rows": 16, "square": "3cm", "marker": "2cm", "dictionary": "DICT_4X4_50"},
            "a charuco of 19x16 needs 170 markers; DICT_4X4_50 has 50",
        ),
        (
            "charuco",
            {"columns": 9, "rows": 6, "square": "3cm", "marker": "2cm", "legacy": 1},
            "legacy is 1: expected true or false",
        ),
        ("aprilgrid", {"columns": 6, "rows": 6, "tag": "3cm", "spacing": 3}, "spacing is 3: expected the gap"),
        ("aprilgrid", {"columns": 6, "rows": 6, "tag": "3cm", "spacing": "9mm"}, "spacing is '9mm': expected a number"),
        ("aprilgrid", {"columns": 30, "rows": 20, "tag": "3cm", "spacing": 0.3}, "needs 600 tags; .* has 587"),
        ("circles", {"columns": 4, "rows": 2, "spacing": "2cm"}, "2 columns and 3 rows or more, got 4x2"),
        ("circles", {"columns": 4, "rows": 11, "spacing": "2cm", "diameter": "3cm"}, "28.28 mm apart"),
    ],
)
def test_invalid_board_raises_with_the_reason(kind, values, message):
    with pytest.raises(ValueError, match=message):
        board_class(kind).from_dict(values)


def test_circles_of_unknown_diameter_cannot_be_drawn():
    board = circles(4, 11, 0.02)
    assert board.size == 44
    with pytest.raises(ValueError, match="the diameter of the circles of the 4x11 board is unknown"):
        board.drawing()
