"""Detection of distorted boards: ids, pixels and covariances match the truth."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnisight.targets.boards.charuco import Charuco
from omnisight.targets.boards.circles import CircleGrid, disc_centroid_offset
from omnisight.targets.boards.symmetric_circles import SymmetricCircles
from omnisight.targets.detectors import detect, measure
from omnisight.targets.detectors.circles import _canonical_ids
from pace import assert_quick
from prints import APRIL, CHARUCO, CIRCLES, SIZE, pose, projector, render


def middles(board, lens, placed, truth, *, mirrored=False):
    """Return where the images of the discs have their middles."""
    shift = disc_centroid_offset(projector(lens, placed), board.points, board.diameter / 2)
    return truth + shift * ([-1, 1] if mirrored else [1, 1])


def rotations(board, truth):
    """Return the places of the board's points after each rotation that maps the board onto itself."""
    turned = [truth, truth[::-1]] if board.is_symmetric else [truth]
    if isinstance(board, SymmetricCircles) and board.columns == board.rows:
        quarter = np.rot90(truth.reshape(board.rows, board.columns, 2)).reshape(-1, 2)
        turned += [quarter, quarter[::-1]]
    return turned


def inside(pixels, margin):
    return ((pixels > margin) & (pixels < np.array(SIZE) - 1 - margin)).all(axis=1)


def errors(found, truth):
    """Return the rms error in px, and the mean normalised squared error: 1 where the covariance is right."""
    error = found.pixels - truth[found.ids]
    normalised = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error) / 2
    return np.sqrt((error**2).sum(axis=1).mean()), normalised.mean()


VIEWS = [("fisheye", 0, 0.17), ("fisheye", 60, 0.17), ("fisheye", 85, 0.12), ("mirror", 30, 0.17), ("mirror", 85, 0.14)]


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
@pytest.mark.parametrize(("lens", "angle", "distance"), VIEWS)
def test_points_of_marker_boards_match_the_truth(board, lens, angle, distance):
    image, truth = render(board, lens, pose(board, angle, distance=distance))
    (found,) = detect(image, board)
    there = inside(truth, 5)
    assert len(found) >= 0.9 * there.sum()  # where the image cuts the board, what is left of it
    rms, normalised = errors(found, truth)
    assert rms < 0.1
    assert 0.5 < normalised < 2
    assert found.located
    assert found.note == ""


@pytest.mark.parametrize(
    "board",
    [
        CIRCLES,
        CircleGrid(5, 8, spacing=0.02, diameter=0.016),
        SymmetricCircles(7, 5, spacing=0.028, diameter=0.016),
        SymmetricCircles(6, 6, spacing=0.028, diameter=0.016),
    ],
    ids=lambda board: f"{board.kind} {board}",
)
@pytest.mark.parametrize(("lens", "angle", "distance"), VIEWS)
def test_centres_of_discs_match_the_truth(board, lens, angle, distance):
    placed = pose(board, angle, distance=distance)
    image, truth = render(board, lens, placed)
    (found,) = detect(image, board)
    assert len(found) >= 0.9 * inside(truth, 16).sum()
    truth = middles(board, lens, placed, truth)
    rms, normalised = min(errors(found, t) for t in rotations(board, truth))
    assert rms < 0.05
    assert 0.5 < normalised < 2
    assert found.located


@pytest.mark.parametrize(
    ("board", "distance", "cell"), [(APRIL, 0.3, 1.9), (APRIL, 0.35, 1.6), (CHARUCO, 0.35, 1.8)], ids=str
)
def test_markers_with_cells_of_two_blurred_pixels_are_decoded(board, distance, cell):
    image, truth = render(board, "fisheye", pose(board, 30, distance=distance))
    cells = 10 if board is APRIL else 9.3  # along a tag; along a square, whose marker has 7 cells on 0.75 of the side
    assert np.median(np.linalg.norm(truth[1::2] - truth[::2], axis=1)) / cells == pytest.approx(cell, abs=0.1)
    (found,) = detect(cv2.GaussianBlur(image, (0, 0), 0.6), board)
    assert len(found) == board.size
    assert errors(found, truth)[0] < 0.1


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
def test_ids_are_right_in_a_mirror_image(board):
    image, truth = render(board, "fisheye", pose(board, 40), mirrored=True)
    (found,) = detect(image, board)
    assert len(found) >= 0.95 * board.size
    assert errors(found, truth)[0] < 0.1


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
def test_marker_boards_printed_white_on_black_are_detected(board, mirrored):
    image, truth = render(board, "fisheye", pose(board, 40), mirrored=mirrored)
    (expected,), (found,) = detect(image, board), detect(255 - image, board)
    assert len(found) >= 0.95 * board.size
    assert errors(found, truth)[0] < 0.1
    np.testing.assert_array_equal(found.ids, expected.ids)
    np.testing.assert_allclose(found.pixels, expected.pixels, atol=0.01)


@pytest.mark.parametrize("board", [CIRCLES, CircleGrid(5, 8, spacing=0.02)], ids=str)
def test_mirrored_circles_are_right_up_to_symmetry(board):
    shown = CircleGrid(board.columns, board.rows, board.spacing, 0.016)  # the diameter need not be known
    placed = pose(shown, 40, distance=0.15)
    image, truth = render(shown, "fisheye", placed, mirrored=True)
    (found,) = detect(image, board)
    assert len(found) == board.size
    grid = middles(shown, "fisheye", placed, truth, mirrored=True).reshape(board.rows, board.columns, 2)
    # Of an odd number of rows the mirrored grid is the grid, so it is taken for one that is not mirrored.
    likely = [grid, grid[::-1, ::-1]] if board.is_symmetric else [grid[::-1]]
    assert min(errors(found, t.reshape(-1, 2))[0] for t in likely) < 0.05


@pytest.mark.parametrize(
    "wrong", [{"legacy": True}, {"columns": 5, "rows": 8}, {"columns": 5, "rows": 8, "legacy": True}]
)
def test_charuco_of_another_layout_is_detected_with_a_note(wrong):
    shown = Charuco(8, 5, square=0.024, marker=0.018)
    asked = Charuco(**{"columns": 8, "rows": 5, "square": 0.024, "marker": 0.018, **wrong})
    if "rows" in wrong and asked.legacy:
        shown = Charuco(8, 5, square=0.024, marker=0.018, legacy=True)
    placed = pose(shown, 30)
    image, _ = render(shown, "fisheye", placed)
    (found,) = detect(image, asked)
    assert len(found) == asked.size
    assert "the print has" in found.note
    # The points of the board that was asked for, turned onto the other by a quarter where they must be.
    points = asked.points
    if asked.columns == 5:
        points = np.stack([points[:, 1], (asked.columns - 1) * asked.square - points[:, 0], points[:, 2]], axis=1)
    assert errors(found, projector("fisheye", placed)(points))[0] < 0.1


@pytest.mark.parametrize("legacy", [False, True])
def test_both_charuco_layouts_are_detected_without_a_note(legacy):
    board = Charuco(8, 5, square=0.024, marker=0.018, legacy=legacy)
    image, truth = render(board, "fisheye", pose(board, 30))
    (found,) = detect(image, board)
    assert (len(found), found.note) == (board.size, "")
    assert errors(found, truth)[0] < 0.1


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
def test_part_of_a_marker_board_has_the_right_ids(board):
    image, truth = render(board, "fisheye", pose(board, 30))
    middle = int(np.median(truth[:, 0]))
    part = np.ascontiguousarray(image[:, middle:])
    (found,) = detect(part, board)
    moved = truth - (middle, 0)
    assert len(found) >= 0.9 * (moved[:, 0] > 5).sum()
    assert (moved[found.ids, 0] > 3).all()
    assert errors(found, moved)[0] < 0.1


def test_part_of_a_circle_grid_has_the_right_ids_next_to_its_margin():
    placed = pose(CIRCLES, 30)
    image, truth = render(CIRCLES, "fisheye", placed)
    truth = middles(CIRCLES, "fisheye", placed, truth)
    low = int(np.percentile(truth[:, 0], 25))
    (found,) = detect(np.ascontiguousarray(image[:, low:]), CIRCLES)
    assert found.located
    assert 0.5 * CIRCLES.size < len(found) < 0.8 * CIRCLES.size
    assert errors(found, truth - (low, 0))[0] < 0.05


def test_bright_circles_on_dark_are_detected():
    placed = pose(CIRCLES, 30)
    image, truth = render(CIRCLES, "fisheye", placed)
    (found,) = detect(255 - image, CIRCLES)
    assert errors(found, middles(CIRCLES, "fisheye", placed, truth))[0] < 0.05


def test_other_boards_are_not_detected():
    image, _ = render(CHARUCO, "fisheye", pose(CHARUCO, 0))
    circles, _ = render(CIRCLES, "fisheye", pose(CIRCLES, 0))
    assert detect(image, Charuco(9, 6, square=0.024, marker=0.018, dictionary="DICT_4X4_100")) == []
    assert detect(image, APRIL) == []
    assert detect(image, CIRCLES) == []
    assert detect(circles, CHARUCO) == []
    for columns, rows in ((4, 9), (3, 11), (5, 13), (5, 11), (4, 12)):
        assert detect(circles, CircleGrid(columns, rows, spacing=0.02)) == []


@pytest.mark.parametrize("board", [CHARUCO, APRIL, CIRCLES], ids=["charuco", "aprilgrid", "circles"])
@pytest.mark.parametrize("kind", ["black", "white", "noise", "ramp", "tiny", "empty"])
def test_images_without_a_board_give_no_detection_quickly(kind, board):
    size = {"tiny": (3, 5), "empty": (0, 0)}.get(kind, (1000, 1200))
    image = {
        "noise": lambda: np.random.default_rng(0).integers(0, 256, size, dtype=np.uint8),
        "ramp": lambda: np.ascontiguousarray(np.broadcast_to(np.linspace(0, 255, size[1]).astype(np.uint8), size)),
    }.get(kind, lambda: np.full(size, 255 if kind == "white" else 0, np.uint8))()
    found = []
    assert_quick(lambda: found.append(detect(image, board)), 120)  # noise takes 25, all else less than 5
    assert found[-1] == []


def bricks(width, height):
    y, x = np.mgrid[:3000, :4000]
    x = x + y // height % 2 * (width // 2)
    return np.where((y % height < 3) | (x % width < 3), 190, 90).astype(np.uint8)


def checks(side):
    y, x = np.mgrid[:3000, :4000]
    return np.where((x // side + y // side) % 2, 200, 50).astype(np.uint8)


@pytest.mark.parametrize("wall", [lambda: bricks(60, 20), lambda: checks(20), lambda: checks(40)])
def test_board_in_front_of_many_squares_is_detected_quickly(wall):
    image = wall()
    shown, _ = render(CHARUCO, "fisheye", pose(CHARUCO, 30))
    image[540:2460, 800:3200] = cv2.resize(shown, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    found = []
    assert_quick(lambda: found.append(detect(image, CHARUCO)), 100)  # 20, and without a bound thousands
    assert [len(board) for board in found[-1]] == [CHARUCO.size]


def test_uniform_image_gives_no_ellipse():
    black = np.random.default_rng(0).integers(9, 11, SIZE[::-1]).astype(np.uint8)
    for image in (black, np.full_like(black, 128)):
        found = measure(image, CIRCLES, np.array([[300.0, 300.0]]), 20 * np.eye(2)[None], np.zeros((1, 2, 2)))
        assert np.isnan(found.pixels).all()
        assert not (found.explained > 0).any()


@pytest.mark.parametrize(("columns", "rows", "alike"), [(4, 10, True), (4, 11, False)])
def test_rotated_ids_are_equivalent_only_for_symmetric_circle_grids(columns, rows, alike):
    board = CircleGrid(columns, rows, spacing=0.02)
    ids = np.array([0, 5, -1, 17])
    turned = np.where(ids < 0, ids, board.size - 1 - ids)
    assert (_canonical_ids(ids, board) == _canonical_ids(turned, board)) is alike
    assert _canonical_ids(np.array([1, 2]), board) != _canonical_ids(np.array([2, 1]), board)


def test_centroid_offset_of_a_tilted_disc_matches_integration():
    tilt = Rotation.from_euler("X", 50, degrees=True)

    def project(points):
        seen = tilt.apply(points) + np.array([0.02, 0.01, 0.1])
        return 400 * seen[:, :2] / seen[:, 2:]

    radius = 0.02
    at = (np.arange(600) - 299.5) / 300 * radius
    x, y = (a.ravel() for a in np.meshgrid(at, at))
    x, y = x[np.hypot(x, y) < radius], y[np.hypot(x, y) < radius]
    disc = np.stack([x, y, 0 * x], axis=1)
    # The area that a piece of the disc covers in this image goes with the cube of its inverse depth.
    weight = (tilt.apply(disc)[:, 2] + 0.1) ** -3
    expected = (project(disc) * weight[:, None]).sum(axis=0) / weight.sum() - project(np.zeros((1, 3)))[0]
    np.testing.assert_allclose(disc_centroid_offset(project, np.zeros((1, 3)), radius)[0], expected, atol=0.03)
    assert np.linalg.norm(expected) > 2


@pytest.mark.parametrize("board", [CHARUCO, APRIL, CIRCLES], ids=["charuco", "aprilgrid", "circles"])
def test_points_are_measured_near_predicted_pixels(board):
    placed = pose(board, 50)
    image, truth = render(board, "fisheye", placed)
    at = projector("fisheye", placed)
    ahead = [at(board.points + board.window_step * np.eye(3)[k]) - truth for k in (0, 1)]
    behind = [at(board.points - board.window_step * np.eye(3)[k]) - truth for k in (0, 1)]
    steps, bends = ((np.stack(ahead, 1) + sign * np.stack(behind, 1)) / 2 for sign in (-1, 1))
    measured = measure(image, board, truth + 0.4, steps, bends)
    wanted = middles(board, "fisheye", placed, truth) if board is CIRCLES else truth
    assert np.sqrt(((measured.pixels - wanted) ** 2).sum(axis=1).mean()) < 0.1
    if board is not CIRCLES:
        assert ((measured.amplitude > 0) == board.bright_ahead).all()


def test_discs_that_the_image_cuts_are_not_measured():
    placed = pose(CIRCLES, 20)
    image, truth = render(CIRCLES, "fisheye", placed)
    at = projector("fisheye", placed)
    half = CIRCLES.window_step * np.eye(3)[:2]
    steps = np.stack([at(CIRCLES.points + h) - at(CIRCLES.points - h) for h in half], 1) / 2
    left = round(np.quantile(truth[:, 0], 0.4))
    inside = truth[:, 0] - left > np.linalg.norm(steps[:, :, 0], axis=1) * 0.01 / CIRCLES.window_step + 1
    assert 10 < inside.sum() < 34
    cut = np.ascontiguousarray(image[:, left:])
    measured = measure(cut, CIRCLES, truth - (left, 0), steps, np.zeros_like(steps))
    np.testing.assert_array_equal(np.isfinite(measured.pixels[:, 0]), inside)
    np.testing.assert_array_equal(np.isfinite(measured.explained), inside)
