"""Detection of partial boards, several boards, and no board."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from drawn import CENTRE, FOCAL, SIZE, corners, pose, scene, shot
from omnisight.targets import Checkerboard, detect, detect_checkerboard
from omnisight.targets.detectors.checkerboard.board_assignment import assign_to_board, most_common_pattern
from omnisight.targets.detectors.checkerboard.grid_search import find_grids

BOARD = Checkerboard(9, 6)
HAND = 125


def right(found, truth, board=BOARD):
    """Check that pixels are right to a third of a pixel, and ids, or at least the steps between them, are right."""
    away = np.linalg.norm(found.pixels[:, None] - truth, axis=2)
    true = away.argmin(axis=1)
    assert away.min(axis=1).max() < 0.35
    assert (np.diff(found.ids) > 0).all()
    if found.located and not board.is_symmetric:
        np.testing.assert_array_equal(found.ids, true)
        return
    # The true rows and columns follow from those found by turning and moving them, without mirroring.
    here, there = (np.stack(np.divmod(ids, board.columns), axis=1) for ids in (found.ids, true))
    turned = [here @ np.linalg.matrix_power([[0, -1], [1, 0]], k) for k in range(4)]
    assert any((np.ptp(there - each, axis=0) == 0).all() for each in turned)


VIEW, TILTED = (0, 0, 8, 8), (20, 10, 130, 6)


def kept(truth, size):
    """Return which corners are well inside an image."""
    return ((truth > 6) & (truth < np.array(size) - 7)).all(axis=1)


@pytest.mark.parametrize("view", [VIEW, TILTED, (-30, 10, -50, 7)])
@pytest.mark.parametrize("side", ["left", "top", "right", "bottom", "left and top"])
@pytest.mark.parametrize("part", [0.25, 0.45])
def test_board_cut_by_the_image_border_is_detected_up_to_it(view, side, part):
    image, truth = shot(view)
    cut = [0, 0, *SIZE]
    for name in side.split(" and "):
        k = ["left", "top", "right", "bottom"].index(name)
        cut[k] = round(np.quantile(truth[:, k % 2], part if k < 2 else 1 - part)) + 4
    truth = truth - cut[:2]
    seen = kept(truth, [cut[2] - cut[0], cut[3] - cut[1]])
    found = detect_checkerboard(image[cut[1] : cut[3], cut[0] : cut[2]], BOARD)
    if seen.sum() < 12:  # a fifth of the board
        assert found is None or found.located is False
        return
    assert found is not None
    right(found, truth)
    assert len(found) > 0.85 * seen.sum()


@pytest.mark.parametrize("sees", [60, 75])
@pytest.mark.parametrize("view", [(58, 5, 10, 7), (-20, 50, 100, 6), (40, -45, -160, 6)])
def test_board_cut_by_the_image_circle_is_detected_up_to_it(view, sees):
    placed = pose(BOARD, *view)
    truth = corners(BOARD, placed)
    radius = np.linalg.norm(truth - CENTRE, axis=1)
    sees = min(np.radians(sees), np.quantile(radius, 0.8) / FOCAL)
    found = detect_checkerboard(scene((BOARD, placed, True), sees=sees), BOARD)
    seen = (radius < sees * FOCAL - 6) & kept(truth, SIZE)
    assert found is not None
    assert len(found) > 0.8 * seen.sum()
    away = np.linalg.norm(found.pixels[:, None] - truth, axis=2)
    at, error = radius[away.argmin(axis=1)], away.min(axis=1)
    assert (at < sees * FOCAL).all()
    # A corner at the very rim is pulled in by the dark, and known to be doubtful.
    assert (error < np.maximum(0.35, 5 * np.sqrt(np.trace(found.covariance, axis1=1, axis2=2)))).all()
    inside = at < sees * FOCAL - 6
    right(replace(found, **{k: getattr(found, k)[inside] for k in ("ids", "pixels", "covariance")}), truth)


def covered(columns):
    """Cover some columns of the board, past its margin."""
    image, truth = shot(VIEW)
    grid = truth.reshape(6, 9, 2)
    low, high = columns
    above, below = (2.5 * grid[a, [low, high]] - 1.5 * grid[b, [low, high]] for a, b in ((0, 2), (-1, -3)))
    outward = 80 * np.array([-(low == 0), high == 8])[:, None] * [1, 0.1]
    hand = image.copy()
    cv2.fillPoly(hand, [np.rint(np.concatenate([above + outward, (below + outward)[::-1]])).astype(np.int32)], HAND)
    return hand, truth


@pytest.mark.parametrize("columns", [(6, 8), (0, 2), (7, 8)])
def test_board_with_one_covered_end_is_located(columns):
    hand, truth = covered(columns)
    found = detect_checkerboard(hand, BOARD)
    assert found is not None
    right(found, truth)
    assert found.located
    hidden = np.isin(np.arange(BOARD.size) % 9, np.arange(columns[0], columns[1] + 1))
    assert not hidden[found.ids].any()
    assert len(found) >= 0.85 * (~hidden).sum()


def test_board_with_both_ends_covered_is_not_located():
    image, truth = covered((6, 8))
    image = np.where(covered((0, 1))[0] == HAND, np.uint8(HAND), image)
    found = detect_checkerboard(image, BOARD)
    assert found is not None
    assert not found.located
    right(found, truth)


def test_small_visible_part_of_a_covered_board_is_rejected():
    hand, _ = covered((3, 8))
    assert [len(grid) for grid in find_grids(hand)] == [18]
    assert detect_checkerboard(hand, BOARD) is None


def test_grid_reports_the_border_of_each_side():
    image, truth = shot(VIEW)
    (whole,) = find_grids(image)
    assert whole.borders == ("margin",) * 4
    (cut,) = find_grids(image[:, : round(truth[:, 0].mean())])
    assert cut.borders == ("margin", "margin", "margin", "cut")
    (circle,) = find_grids(scene((BOARD, pose(BOARD, *VIEW), True), sees=np.radians(20)))
    assert "margin" not in circle.borders
    (hand,) = find_grids(covered((6, 8))[0])
    assert hand.borders == ("margin", "margin", "margin", "open")


@pytest.mark.parametrize("quarters", range(4))
def test_rotated_grid_keeps_its_corners_colours_and_borders(quarters):
    image, truth = shot(VIEW)
    half = image[:, : round(truth[:, 0].mean())]
    (grid,), (seen,) = find_grids(half), find_grids(np.rot90(half, quarters))
    turned = grid.rotated(quarters)
    assert (turned.shape, turned.borders, turned.starts_dark) == (seen.shape, seen.borders, seen.starts_dark)
    np.testing.assert_array_equal(turned.rotated(-quarters).pixels, grid.pixels)


def test_part_of_a_board_is_located_only_if_borders_and_colours_are_unique():
    """The left half of a board between its margins has one place; a part amid it has several."""
    image, truth = shot(VIEW)
    low, high = (round(np.quantile(truth[:, 0], q)) for q in (0.25, 0.75))
    (left,), (amid,) = find_grids(image[:, :high]), find_grids(image[:, low:high])
    assert assign_to_board(left, BOARD).located
    assert not assign_to_board(amid, BOARD).located
    assert assign_to_board(amid, Checkerboard(5, 4)) is None  # more rows than such a board has


def test_several_boards_in_one_image_are_all_detected():
    small = Checkerboard(5, 4)
    views = [(BOARD, (-38, 0, 10, 9)), (BOARD, (36, 22, 95, 10)), (small, (38, -40, -30, 9))]
    image = scene(*((board, pose(board, *view), True) for board, view in views))
    grids = find_grids(image)
    assert sorted(grid.pattern for grid in grids) == [(5, 4), (9, 6), (9, 6)]
    assert [len(grid) for grid in grids] == [54, 54, 20]
    assert all(set(grid.borders) == {"margin"} for grid in grids)
    for board, count in ((BOARD, 2), (small, 1)):
        found = detect(image, board)
        assert len(found) == count
        truths = [corners(b, pose(b, *view)) for b, view in views if b is board]
        for detection in found:
            nearest = min(truths, key=lambda t: np.linalg.norm(t.mean(0) - detection.pixels.mean(0)))
            right(detection, nearest, board)


@pytest.mark.parametrize("view", [VIEW, TILTED])
@pytest.mark.parametrize("pattern", [(5, 4), (9, 4), (4, 3)])
def test_complete_smaller_board_is_no_part_of_a_larger_one(view, pattern):
    image, truth = shot(view, *pattern)
    assert detect_checkerboard(image, BOARD) is None
    assert len(detect_checkerboard(image, Checkerboard(*pattern))) == len(truth)


@pytest.mark.parametrize(("view", "dark"), [(VIEW, True), (TILTED, False)])
@pytest.mark.parametrize("pattern", [(9, 6), (8, 6), (6, 6), (7, 7), (8, 7), (5, 5)])
def test_boards_of_every_parity_and_colour_are_detected_completely(view, pattern, dark):
    image, truth = shot(view, *pattern, dark=dark)
    board = Checkerboard(*pattern)
    found = detect_checkerboard(image, board)
    assert found is not None
    assert found.located or pattern[0] == pattern[1]
    assert len(found) == board.size
    if not board.is_symmetric and not dark:
        truth = truth[::-1]  # printed so, it is the same board upside-down
    right(found, truth, board)


def starts(pattern, quarters):
    """Return which true corner each id is when the camera is turned, for an image seen upright by the detector."""
    image, truth = shot(VIEW, *pattern)
    found = detect_checkerboard(np.rot90(image, quarters), Checkerboard(*pattern))
    for _ in range(quarters):  # undo: u, v of the turned image in the one before
        width = image.shape[1]
        image = np.rot90(image)
        truth = np.stack([truth[:, 1], width - 1 - truth[:, 0]], axis=1)
    return int(np.linalg.norm(truth - found.pixels[0], axis=1).argmin())


def test_rotations_of_a_board_onto_itself_depend_on_its_parity():
    assert {starts((9, 6), k) for k in range(4)} == {0}
    assert {starts((8, 6), k) for k in range(4)} == {0, 47}
    assert {starts((6, 6), k) for k in range(4)} == {0, 5, 30, 35}


def test_odd_square_board_starts_at_one_of_two_corners():
    assert {starts((7, 7), k) for k in range(4)} == {0, 48}
    assert detect_checkerboard(shot(VIEW, 7, 7)[0], Checkerboard(7, 7)).located


@pytest.mark.parametrize("view", [VIEW, TILTED])
def test_mirrored_board_is_numbered_like_an_unmirrored_one(view):
    image, truth = shot(view)
    found = detect_checkerboard(image[:, ::-1], BOARD)
    assert len(found) == BOARD.size
    assert found.located
    grid = found.pixels.reshape(6, 9, 2)
    flipped = np.stack([SIZE[0] - 1 - truth[:, 0], truth[:, 1]], axis=1).reshape(6, 9, 2)[::-1]
    assert np.abs(grid - flipped).max() < 0.35
    half = image[:, ::-1][:, : round(flipped[..., 0].mean())]
    part = detect_checkerboard(half, BOARD)
    assert part is not None
    right(part, flipped.reshape(-1, 2))


def test_most_common_pattern_is_that_of_most_complete_boards():
    image, truth = shot(VIEW)
    whole, cut = find_grids(image), find_grids(image[:, : round(truth[:, 0].mean())])
    other, none = find_grids(shot(VIEW, 7, 5)[0]), []
    assert most_common_pattern([whole, cut, cut, none]) == (9, 6)
    assert most_common_pattern([cut, cut, cut, whole, none, whole]) == (9, 6)
    assert most_common_pattern([[*whole, *whole], other, other]) == (7, 5)  # images count, not boards
    assert most_common_pattern([cut, none]) == cut[0].pattern
    assert most_common_pattern([none, none]) is most_common_pattern([]) is None
    assert most_common_pattern([find_grids(np.rot90(image))]) == (9, 6)


def clutter(kind, rng, size=(640, 480)):
    """Draw an image of clutter without any board."""
    image = np.full(size[::-1], 120, np.uint8)
    v, u = np.mgrid[: size[1], : size[0]]
    match kind:
        case "boxes":
            for _ in range(120):
                box = (rng.uniform((0, 0), size).tolist(), rng.uniform(8, 120, 2).tolist(), float(rng.uniform(0, 180)))
                corners = np.rint(cv2.boxPoints(box) * 16).astype(np.int32)
                cv2.fillConvexPoly(image, corners, rng.uniform(15, 235), cv2.LINE_AA, 4)
        case "text":
            for line in range(20, 480, 24):
                words = "".join(rng.choice(list("HEXLMTFKAZ#%+=H "), 40))
                cv2.putText(image, words, (5, line), cv2.FONT_HERSHEY_DUPLEX, 0.8, 20, 2, cv2.LINE_AA)
        case "noise":
            image = rng.integers(0, 256, size[::-1], dtype=np.uint8)
        case "stripes":
            image = np.where(u < 300, 120 + 90 * (v // 12 % 2), 40 + 180 * (u // 9 % 2))
        case "a line of tiles":
            image = np.where((v // 24 == 8) | (v // 24 == 9), 30 + 190 * ((u // 24 + v // 24) % 2), image)
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


KINDS = ("boxes", "text", "noise", "stripes", "a line of tiles")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_clutter_is_no_board_of_any_pattern(kind, seed):
    grids = find_grids(clutter(kind, np.random.default_rng(seed)))
    asked = [Checkerboard(*size) for size in ((9, 6), (8, 6), (7, 7), (6, 6), (5, 4), (4, 3), (11, 8), (3, 3))]
    assert not any(assign_to_board(grid, board) for grid in grids for board in asked)


@pytest.mark.parametrize("kind", KINDS)
def test_clutter_around_a_board_does_not_hide_it(kind):
    image, truth = shot(VIEW)
    around = clutter(kind, np.random.default_rng(7))
    (left, top), (right_, bottom) = truth.min(0).astype(int) - 60, truth.max(0).astype(int) + 60
    around[max(top, 0) : bottom, max(left, 0) : right_] = image[max(top, 0) : bottom, max(left, 0) : right_]
    found = detect(around, BOARD)
    assert [len(f) for f in found] == [BOARD.size]
    right(found[0], truth)


@pytest.mark.parametrize("high", [0, 1, 2, 16, 17, 33, 400])
@pytest.mark.parametrize("wide", [1, 2, 16, 17, 65])
def test_images_of_any_size_can_be_searched(wide, high):
    size = high, wide
    rng = np.random.default_rng(size[0] + 1000 * size[1])
    squares = np.asarray(255 * (np.add.outer(np.arange(size[0]) // 8, np.arange(size[1]) // 8) % 2), np.uint8)
    assert not find_grids(rng.integers(0, 256, size, dtype=np.uint8))
    assert not find_grids(255 * rng.integers(0, 2, size, dtype=np.uint8))
    grids = find_grids(squares)
    assert bool(grids) == (min(size) >= 33)  # squares of 8 px: fewer have too few corners
    for grid in grids:
        there = grid.pixels[grid.present]
        assert len(there) > 0
        assert ((there >= 0) & (there <= np.array(size[::-1]) - 1)).all()
