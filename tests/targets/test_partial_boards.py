"""Boards that an image shows in part, several at once, or not at all."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from drawn import CENTRE, FOCAL, SIZE, corners, pose, scene, shot
from omnisight.targets import Checkerboard, detect_checkerboard
from omnisight.targets.grids.search import find_grids
from omnisight.targets.placing import agreed_pattern, detect_checkerboards, pattern_of, place

BOARD = Checkerboard(9, 6)
HAND = 125


def right(found, truth, board=BOARD):
    """Check a detection of a board: places to a third of a pixel, and ids, or the steps between them, as they are."""
    away = np.linalg.norm(found.pixels[:, None] - truth, axis=2)
    true = away.argmin(axis=1)
    assert away.min(axis=1).max() < 0.35
    assert (np.diff(found.ids) > 0).all()
    if found.located and not board.symmetric:
        np.testing.assert_array_equal(found.ids, true)
        return
    # The true rows and columns follow from those found by turning and moving them, without mirroring.
    here, there = (np.stack(np.divmod(ids, board.columns), axis=1) for ids in (found.ids, true))
    turned = [here @ np.linalg.matrix_power([[0, -1], [1, 0]], k) for k in range(4)]
    assert any((np.ptp(there - each, axis=0) == 0).all() for each in turned)


VIEW, TILTED = (0, 0, 8, 8), (20, 10, 130, 6)


def kept(truth, size):
    """Say which corners are well inside an image."""
    return ((truth > 6) & (truth < np.array(size) - 7)).all(axis=1)


@pytest.mark.parametrize("view", [VIEW, TILTED, (-30, 10, -50, 7)])
@pytest.mark.parametrize("side", ["left", "top", "right", "bottom", "left and top"])
@pytest.mark.parametrize("part", [0.25, 0.45])
def test_a_board_cut_by_the_edge_of_the_picture_is_found_as_far_as_it_goes(view, side, part):
    picture, truth = shot(view)
    cut = [0, 0, *SIZE]
    for name in side.split(" and "):
        k = ["left", "top", "right", "bottom"].index(name)
        cut[k] = round(np.quantile(truth[:, k % 2], part if k < 2 else 1 - part)) + 4
    truth = truth - cut[:2]
    seen = kept(truth, [cut[2] - cut[0], cut[3] - cut[1]])
    found = detect_checkerboard(picture[cut[1] : cut[3], cut[0] : cut[2]], BOARD)
    if seen.sum() < 12:  # a fifth of the board
        assert found is None or found.located is False
        return
    assert found is not None
    right(found, truth)
    assert len(found) > 0.85 * seen.sum()


@pytest.mark.parametrize("sees", [60, 75])
@pytest.mark.parametrize("view", [(58, 5, 10, 7), (-20, 50, 100, 6), (40, -45, -160, 6)])
def test_a_board_that_reaches_into_the_dark_around_the_circle_is_found_as_far_as_it_is_seen(view, sees):
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
    """Lay a hand over some columns of corners of the board, past its margin."""
    picture, truth = shot(VIEW)
    grid = truth.reshape(6, 9, 2)
    low, high = columns
    above, below = (2.5 * grid[a, [low, high]] - 1.5 * grid[b, [low, high]] for a, b in ((0, 2), (-1, -3)))
    outward = 80 * np.array([-(low == 0), high == 8])[:, None] * [1, 0.1]
    hand = picture.copy()
    cv2.fillPoly(hand, [np.rint(np.concatenate([above + outward, (below + outward)[::-1]])).astype(np.int32)], HAND)
    return hand, truth


@pytest.mark.parametrize("columns", [(6, 8), (0, 2), (7, 8)])
def test_a_hand_over_one_end_leaves_the_rest_of_the_board_in_its_place(columns):
    hand, truth = covered(columns)
    found = detect_checkerboard(hand, BOARD)
    assert found is not None
    right(found, truth)
    assert found.located
    hidden = np.isin(np.arange(BOARD.size) % 9, np.arange(columns[0], columns[1] + 1))
    assert not hidden[found.ids].any()
    assert len(found) >= 0.85 * (~hidden).sum()


def test_hands_over_both_ends_leave_it_open_which_columns_are_seen():
    picture, truth = covered((6, 8))
    picture = np.where(covered((0, 1))[0] == HAND, np.uint8(HAND), picture)
    found = detect_checkerboard(picture, BOARD)
    assert found is not None
    assert not found.located
    right(found, truth)


def test_too_little_behind_a_hand_is_not_taken_for_the_board():
    hand, _ = covered((3, 8))
    assert [len(grid) for grid in find_grids(hand)] == [18]
    assert detect_checkerboard(hand, BOARD) is None


def test_a_grid_tells_how_it_ends_on_each_side():
    picture, truth = shot(VIEW)
    (whole,) = find_grids(picture)
    assert whole.ends == ("margin",) * 4
    (cut,) = find_grids(picture[:, : round(truth[:, 0].mean())])
    assert cut.ends == ("margin", "margin", "margin", "cut")
    (circle,) = find_grids(scene((BOARD, pose(BOARD, *VIEW), True), sees=np.radians(20)))
    assert "margin" not in circle.ends
    (hand,) = find_grids(covered((6, 8))[0])
    assert hand.ends == ("margin", "margin", "margin", "open")


@pytest.mark.parametrize("quarters", range(4))
def test_a_turned_grid_keeps_its_corners_colours_and_ends(quarters):
    picture, truth = shot(VIEW)
    half = picture[:, : round(truth[:, 0].mean())]
    (grid,), (seen,) = find_grids(half), find_grids(np.rot90(half, quarters))
    turned = grid.turned(quarters)
    assert (turned.shape, turned.ends, turned.dark) == (seen.shape, seen.ends, seen.dark)
    np.testing.assert_array_equal(turned.turned(-quarters).pixels, grid.pixels)


def test_a_part_has_one_place_only_as_far_as_edges_and_colours_tell():
    """The left half of a board between its margins has one place; a part amid it has several."""
    picture, truth = shot(VIEW)
    low, high = (round(np.quantile(truth[:, 0], q)) for q in (0.25, 0.75))
    (left,), (amid,) = find_grids(picture[:, :high]), find_grids(picture[:, low:high])
    assert place(left, BOARD).located
    assert not place(amid, BOARD).located
    assert place(amid, Checkerboard(5, 4)) is None  # more rows than such a board has


def test_several_boards_in_one_picture_are_all_found():
    small = Checkerboard(5, 4)
    views = [(BOARD, (-38, 0, 10, 9)), (BOARD, (36, 22, 95, 10)), (small, (38, -40, -30, 9))]
    picture = scene(*((board, pose(board, *view), True) for board, view in views))
    grids = find_grids(picture)
    assert sorted(map(pattern_of, grids)) == [(5, 4), (9, 6), (9, 6)]
    assert [len(grid) for grid in grids] == [54, 54, 20]
    assert all(set(grid.ends) == {"margin"} for grid in grids)
    for board, count in ((BOARD, 2), (small, 1)):
        found = detect_checkerboards(picture, board)
        assert len(found) == count
        truths = [corners(b, pose(b, *view)) for b, view in views if b is board]
        for detection in found:
            nearest = min(truths, key=lambda t: np.linalg.norm(t.mean(0) - detection.pixels.mean(0)))
            right(detection, nearest, board)


@pytest.mark.parametrize("view", [VIEW, TILTED])
@pytest.mark.parametrize("pattern", [(5, 4), (9, 4), (4, 3)])
def test_a_whole_smaller_board_is_no_part_of_a_larger_one(view, pattern):
    picture, truth = shot(view, *pattern)
    assert detect_checkerboard(picture, BOARD) is None
    assert len(detect_checkerboard(picture, Checkerboard(*pattern))) == len(truth)


@pytest.mark.parametrize(("view", "dark"), [(VIEW, True), (TILTED, False)])
@pytest.mark.parametrize("pattern", [(9, 6), (8, 6), (6, 6), (7, 7), (8, 7), (5, 5)])
def test_boards_of_every_parity_and_colour_are_found_whole(view, pattern, dark):
    picture, truth = shot(view, *pattern, dark=dark)
    board = Checkerboard(*pattern)
    found = detect_checkerboard(picture, board)
    assert found is not None
    assert found.located or pattern[0] == pattern[1]
    assert len(found) == board.size
    if not board.symmetric and not dark:
        truth = truth[::-1]  # printed so, it is the same board upside-down
    right(found, truth, board)


def starts(pattern, quarters):
    """Give which true corner each id is when the camera is turned, for an image seen upright by the detector."""
    picture, truth = shot(VIEW, *pattern)
    found = detect_checkerboard(np.rot90(picture, quarters), Checkerboard(*pattern))
    for _ in range(quarters):  # undo: u, v of the turned image in the one before
        width = picture.shape[1]
        picture = np.rot90(picture)
        truth = np.stack([truth[:, 1], width - 1 - truth[:, 0]], axis=1)
    return int(np.linalg.norm(truth - found.pixels[0], axis=1).argmin())


def test_what_turns_a_board_allows_depends_on_its_squares():
    assert {starts((9, 6), k) for k in range(4)} == {0}
    assert {starts((8, 6), k) for k in range(4)} == {0, 47}
    assert {starts((6, 6), k) for k in range(4)} == {0, 5, 30, 35}


def test_an_odd_square_board_starts_at_one_of_two_corners():
    assert {starts((7, 7), k) for k in range(4)} == {0, 48}
    assert detect_checkerboard(shot(VIEW, 7, 7)[0], Checkerboard(7, 7)).located


@pytest.mark.parametrize("view", [VIEW, TILTED])
def test_a_mirrored_board_is_found_and_numbered_as_one_seen_straight(view):
    picture, truth = shot(view)
    found = detect_checkerboard(picture[:, ::-1], BOARD)
    assert len(found) == BOARD.size
    assert found.located
    grid = found.pixels.reshape(6, 9, 2)
    flipped = np.stack([SIZE[0] - 1 - truth[:, 0], truth[:, 1]], axis=1).reshape(6, 9, 2)[::-1]
    assert np.abs(grid - flipped).max() < 0.35
    half = picture[:, ::-1][:, : round(flipped[..., 0].mean())]
    part = detect_checkerboard(half, BOARD)
    assert part is not None
    right(part, flipped.reshape(-1, 2))


def test_a_set_agrees_on_the_board_that_most_of_it_shows_whole():
    picture, truth = shot(VIEW)
    whole, cut = find_grids(picture), find_grids(picture[:, : round(truth[:, 0].mean())])
    other, none = find_grids(shot(VIEW, 7, 5)[0]), []
    assert agreed_pattern([whole, cut, cut, none]) == (9, 6)
    assert agreed_pattern([cut, cut, cut, whole, none, whole]) == (9, 6)
    assert agreed_pattern([[*whole, *whole], other, other]) == (7, 5)  # images count, not boards
    assert agreed_pattern([cut, none]) == pattern_of(cut[0])
    assert agreed_pattern([none, none]) is agreed_pattern([]) is None
    assert agreed_pattern([find_grids(np.rot90(picture))]) == (9, 6)


def clutter(kind, rng, size=(640, 480)):
    """Draw what stands around in a room, no board among it."""
    picture = np.full(size[::-1], 120, np.uint8)
    v, u = np.mgrid[: size[1], : size[0]]
    match kind:
        case "boxes":
            for _ in range(120):
                box = (rng.uniform((0, 0), size).tolist(), rng.uniform(8, 120, 2).tolist(), float(rng.uniform(0, 180)))
                corners = np.rint(cv2.boxPoints(box) * 16).astype(np.int32)
                cv2.fillConvexPoly(picture, corners, rng.uniform(15, 235), cv2.LINE_AA, 4)
        case "text":
            for line in range(20, 480, 24):
                words = "".join(rng.choice(list("HEXLMTFKAZ#%+=H "), 40))
                cv2.putText(picture, words, (5, line), cv2.FONT_HERSHEY_DUPLEX, 0.8, 20, 2, cv2.LINE_AA)
        case "noise":
            picture = rng.integers(0, 256, size[::-1], dtype=np.uint8)
        case "stripes":
            picture = np.where(u < 300, 120 + 90 * (v // 12 % 2), 40 + 180 * (u // 9 % 2))
        case "a line of tiles":
            picture = np.where((v // 24 == 8) | (v // 24 == 9), 30 + 190 * ((u // 24 + v // 24) % 2), picture)
    return np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


KINDS = ("boxes", "text", "noise", "stripes", "a line of tiles")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_what_stands_around_is_no_board_of_any_pattern(kind, seed):
    grids = find_grids(clutter(kind, np.random.default_rng(seed)))
    asked = [Checkerboard(*size) for size in ((9, 6), (8, 6), (7, 7), (6, 6), (5, 4), (4, 3), (11, 8), (3, 3))]
    assert not any(place(grid, board) for grid in grids for board in asked)


@pytest.mark.parametrize("kind", KINDS)
def test_clutter_around_a_board_does_not_hide_it(kind):
    picture, truth = shot(VIEW)
    around = clutter(kind, np.random.default_rng(7))
    (left, top), (right_, bottom) = truth.min(0).astype(int) - 60, truth.max(0).astype(int) + 60
    around[max(top, 0) : bottom, max(left, 0) : right_] = picture[max(top, 0) : bottom, max(left, 0) : right_]
    found = detect_checkerboards(around, BOARD)
    assert [len(f) for f in found] == [BOARD.size]
    right(found[0], truth)


@pytest.mark.parametrize("high", [0, 1, 2, 16, 17, 33, 400])
@pytest.mark.parametrize("wide", [1, 2, 16, 17, 65])
def test_pictures_of_odd_sizes_are_searched_without_complaint(wide, high):
    size = high, wide
    rng = np.random.default_rng(size[0] + 1000 * size[1])
    for picture in (
        rng.integers(0, 256, size, dtype=np.uint8),
        255 * rng.integers(0, 2, size, dtype=np.uint8),
        np.asarray(255 * (np.add.outer(np.arange(size[0]) // 8, np.arange(size[1]) // 8) % 2), np.uint8),
    ):
        for grid in find_grids(picture):
            there = grid.pixels[grid.there]
            assert ((there >= 0) & (there <= np.array(size[::-1]) - 1)).all()
