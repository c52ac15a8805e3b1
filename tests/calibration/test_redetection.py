"""The second look: corners that a first camera foretells are won, measured better, and weighted by their covariance."""

from dataclasses import replace

import numpy as np
import pytest

from calibrating import calibrate, observe
from lenses import bearing_error, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.redetection import RedetectionStats, redetect
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.images import read_image, write_image
from omnisight.simulation import fisheye_setup
from omnisight.targets import Checkerboard, detect_boards
from omnisight.targets.observations import Observations
from prints import CIRCLES
from prints import pose as hold
from prints import render as draw

BOARD = Checkerboard(9, 6, 0.04)
COUNT, WIDTH = 6, 640
FAR = np.radians(80)


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """Images of a board through a fisheye of 190 degrees, its corners, and their angles from the axis."""
    folder = tmp_path_factory.mktemp("second")
    setup = fisheye_setup(WIDTH)
    renderer, truth, angles = setup.renderer(), [], []
    for i, board in enumerate(setup.boards(COUNT, BOARD)):
        picture = renderer([board], np.random.default_rng(i))
        write_image(folder / f"{i}.png", picture.image)
        truth.append(picture.corners[0])
        seen = board.cam_from_board @ BOARD.points
        angles.append(np.arctan2(np.hypot(seen[:, 0], seen[:, 1]), seen[:, 2]))
    return sorted(folder.glob("*.png")), np.array(truth), np.array(angles)


@pytest.fixture(scope="module")
def search(shots):
    """What the first look gives: all of the corners."""
    found = detect_boards(shots[0], BOARD, cache=False)
    assert [len(p.detection) for p in found.images] == [BOARD.size] * COUNT
    return found


def only(detection, ids):
    """Give the part of a detection that has these ids."""
    kept = np.isin(detection.ids, ids)
    return replace(
        detection, ids=detection.ids[kept], pixels=detection.pixels[kept], covariance=detection.covariance[kept]
    )


def changed(search, change):
    """Give a search whose boards are `change(number of the image, detection)`, a tuple, instead."""
    pictures = [replace(p, boards=change(i, p.detection)) for i, p in enumerate(search.images)]
    return replace(search, images=pictures)


def again(search, **options):
    views = Observations.from_detections(search)
    return redetect(search, views, estimate_initial_camera(views, search.size), **options)


def errors(search, truth):
    """Give how far off the corners of all images are (N, 2), px."""
    return np.concatenate([d.pixels - truth[i][d.ids] for i, p in enumerate(search.images) for d in p.boards])


def rms(error):
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_a_whole_first_look_is_kept_and_measured_better(search, shots):
    done = []
    second, won = again(search, progress=lambda *state: done.append(state))
    assert (won.corners, won.far, won.dropped, won.boards) == (0, 0, 0, 0)
    before, after = errors(search, shots[1]), errors(second, shots[1])
    assert rms(after) < rms(before) < 0.02
    assert np.abs(after).max() < 0.05
    assert done == [(i + 1, COUNT) for i in range(COUNT)]
    assert [p.path for p in second.images] == [p.path for p in search.images]


@pytest.mark.parametrize("kept", ["every second", "half a board", "all but the rim", "few"])
def test_corners_that_the_first_look_missed_are_won(search, shots, kept):
    _, truth, angles = shots
    rng = np.random.default_rng(0)
    row, column = np.divmod(np.arange(BOARD.size), BOARD.columns)

    def part(i):
        match kept:
            case "every second":
                return np.flatnonzero((row + column + i) % 2)
            case "half a board":
                return np.flatnonzero(column < 5) if i % 2 else np.flatnonzero(row > 2)
            case "all but the rim":
                return np.flatnonzero(angles[i] < np.quantile(angles[i], 0.7))
        return np.sort(rng.permutation(BOARD.size)[:14])

    parts = [part(i) for i in range(COUNT)]
    less = changed(search, lambda i, d: (only(d, parts[i]),))
    second, won = again(less)
    lost = [np.setdiff1d(np.arange(BOARD.size), ids) for ids in parts]
    assert won.corners == sum(map(len, lost))
    assert won.far == sum(int((angles[i][ids] > FAR).sum()) for i, ids in enumerate(lost))
    assert won.far > 0
    assert (won.dropped, won.boards) == (0, 0)
    assert [p.detection.ids.tolist() for p in second.images] == [list(range(BOARD.size))] * COUNT
    assert rms(errors(second, truth)) < min(0.015, rms(errors(less, truth)) * 1.05)
    assert all(len(p.detection) == len(ids) for p, ids in zip(less.images, parts, strict=True))  # left as it was


def test_notes_follow_what_the_second_look_found(search):
    less = changed(search, lambda i, d: (only(d, range(40)),))
    less = replace(less, images=[p.with_boards(p.boards, BOARD).with_remark("old") for p in less.images])
    assert {p.note for p in less.images} == {"40 of 54 corners; old"}
    second, _ = again(less)
    assert {p.note for p in second.images} == {"old"}


@pytest.mark.parametrize("missed", [(0,), (2, 4)])
def test_boards_that_the_first_look_missed_are_found_in_flat_views(search, shots, missed):
    _, truth, _ = shots
    less = changed(search, lambda i, d: () if i in missed else (d,))
    second, won = again(less)
    assert won.boards == len(missed)
    assert won.corners == sum(len(second.images[i].detection) for i in missed)
    assert rms(errors(second, truth)) < 0.02
    assert ["rectified view" in p.note for p in second.images] == [i in missed for i in range(COUNT)]


@pytest.mark.parametrize("missed", [4, 5])
def test_of_a_board_in_flat_views_all_that_there_is_is_taken(search, missed):
    _, won = again(changed(search, lambda i, d: () if i == missed else (d,)))
    assert won.corners == BOARD.size


def test_far_corners_of_flat_views_are_counted(search, shots):
    second, won = again(changed(search, lambda i, d: () if i == 0 else (d,)))
    assert won.far == int((shots[2][0][second.images[0].detection.ids] > FAR).sum()) > 0


def test_a_part_whose_place_was_not_known_gets_it(search):
    """Its other corners are where only one of the places that it could have puts them."""

    def part(i, d):
        amid = only(d, np.flatnonzero(np.isin(np.arange(BOARD.size) % BOARD.columns, range(3, 8))))
        return (replace(amid, ids=amid.ids - 2, located=False),) if i == 1 else (d,)

    first = changed(search, part)
    second, _ = again(first)
    assert second.images[1].detection.located
    assert second.images[1].detection.ids.tolist() == list(range(BOARD.size))
    np.testing.assert_allclose(second.images[1].detection.pixels, search.images[1].detection.pixels, atol=0.1)


def test_a_picture_without_a_board_stays_without_one(search, tmp_path):
    gray = np.random.default_rng(0).normal(110, 3, (480, 640))
    write_image(tmp_path / "empty.png", gray.astype(np.uint8))
    more = replace(search, images=[*search.images, *detect_boards([tmp_path / "empty.png"], BOARD, cache=False).images])
    (tmp_path / "bad.png").write_bytes(b"no image")
    more = replace(more, images=[*more.images, *detect_boards([tmp_path / "bad.png"], BOARD, cache=False).images])
    second, won = again(more)
    assert won.boards == 0
    assert second.images[COUNT:] == more.images[COUNT:]


@pytest.fixture(scope="module")
def behind_a_hand(shots, tmp_path_factory):
    """The images with a patch over four corners, and the ids of those that are well under it."""
    folder, covered = tmp_path_factory.mktemp("hand"), []
    for path, truth in zip(*shots[:2], strict=True):
        picture = read_image(path).copy()
        hidden = truth[[21, 22, 30, 31]]
        (left, top), (right, bottom) = hidden.min(0).astype(int) - 4, hidden.max(0).astype(int) + 5
        picture[top:bottom, left:right] = 130
        covered.append(np.flatnonzero(((truth > (left + 2, top + 2)) & (truth < (right - 3, bottom - 3))).all(axis=1)))
        write_image(folder / path.name, picture)
    return sorted(folder.glob("*.png")), covered


def test_corners_behind_a_hand_do_not_come_back(behind_a_hand, shots):
    paths, covered = behind_a_hand
    first = detect_boards(paths, BOARD, cache=False)
    assert len(first.images) == len(covered) > 0
    assert min(map(len, covered)) >= 4
    assert all(len(p.boards) == 1 for p in first.images)
    second, won = again(first)
    assert not any(np.isin(ids, p.detection.ids).any() for p, ids in zip(second.images, covered, strict=True))
    assert all(len(p.detection) > 45 for p in second.images)
    assert won.dropped == 0
    # The edge of a hand spoils its neighbours a little, no others.
    error = np.linalg.norm(errors(second, shots[1]), axis=1)
    assert np.median(error) < 0.01
    assert error.max() < 1.5


def fooled(search, paths, ids):
    """Give a search that believes in all corners of images that hide some; the second look, and those it keeps."""
    first = replace(search, images=[replace(p, path=path) for p, path in zip(search.images, paths, strict=True)])
    second, won = again(first)
    return second, won, [np.intersect1d(each, p.detection.ids) for p, each in zip(second.images, ids, strict=True)]


def test_corners_that_are_none_are_dropped(search, behind_a_hand):
    """A first look that believes in corners behind the hand is corrected."""
    second, won, kept = fooled(search, *behind_a_hand)
    count = sum(map(len, behind_a_hand[1]))
    assert won.dropped >= count - sum(map(len, kept)) > 0.8 * count
    assert won.corners == 0
    assert all(len(p.detection) > 44 for p in second.images)


def test_no_corner_behind_a_hand_is_kept(search, behind_a_hand):
    *_, kept = fooled(search, *behind_a_hand)
    assert not any(map(len, kept))


def test_a_corner_in_the_wrong_place_is_measured_anew(search, shots):
    rng = np.random.default_rng(1)

    def stray(i, d):
        pixels = d.pixels.copy()
        pixels[rng.permutation(BOARD.size)[:3]] += rng.choice([-1, 1], (3, 2)) * 1.5
        return (replace(d, pixels=pixels),)

    wrong = changed(search, stray)
    second, won = again(wrong)
    assert rms(errors(wrong, shots[1])) > 0.4
    assert rms(errors(second, shots[1])) < 0.015
    assert won.dropped == 0


def test_one_call_goes_from_the_boards_to_the_camera(search, shots):
    less = changed(search, lambda i, d: () if i == 3 else (only(d, np.arange(0, BOARD.size, 2)),))
    result = calibrate(less, model="kannala_brandt")
    assert result.redetection.corners == COUNT * BOARD.size - (COUNT - 1) * 27
    assert result.redetection.boards == 1
    assert len(result.calibration.views) == len(result.search.found) == COUNT
    assert len(result.calibration.views.pixels) == COUNT * BOARD.size
    assert result.calibration.rms < 0.03
    truth = fisheye_setup(WIDTH).camera
    assert bearing_error(result.calibration.camera, truth.model, np.radians(88)) < 0.05


def test_what_was_won_is_said_in_a_line():
    assert str(RedetectionStats(214, 96)) == "second look: +214 corners, 96 of them beyond 80 degrees"
    assert str(RedetectionStats(214, 96, 0, 3)).endswith("96 of them beyond 80 degrees, +3 boards")
    assert str(RedetectionStats(5, 0, 2)).endswith("+5 corners, 0 of them beyond 80 degrees, 2 not confirmed")
    assert RedetectionStats(1, 2, 3, 4) + RedetectionStats(10, 20, 30, 40) == RedetectionStats(11, 22, 33, 44)


@pytest.fixture(scope="module")
def discs(tmp_path_factory):
    """What a first look finds in images of a board of discs, and the images of their middles."""
    folder, truth = tmp_path_factory.mktemp("discs"), []
    for i, (angle, azimuth) in enumerate(((5, 0), (50, 170), (55, 10))):
        picture, middles = draw(CIRCLES, "fisheye", hold(CIRCLES, angle, azimuth=azimuth, distance=0.14), seed=i)
        write_image(folder / f"{i}.png", picture)
        truth.append(middles)
    first = detect_boards(sorted(folder.glob("*.png")), CIRCLES, cache=False)
    assert [len(p.detection) for p in first.images] == [CIRCLES.size] * len(truth)
    return first, truth


@pytest.mark.parametrize("board", [CIRCLES, replace(CIRCLES, diameter=None)], ids=["diameter known", "not known"])
def test_middles_of_discs_are_led_back_to_the_discs(board, discs):
    """Where the diameter is known the second look gives the images of the discs' middles."""
    first, truth = replace(discs[0], board=board), discs[1]
    less = changed(first, lambda i, d: (only(d, np.arange(0, board.size, 2)),))
    second, won = again(less)
    assert won.corners == len(truth) * board.size / 2
    assert [len(p.detection) for p in second.images] == [board.size] * len(truth)
    before, after = rms(errors(first, truth)), rms(errors(second, truth))
    assert before > 0.3
    if board.diameter is None:
        assert after == pytest.approx(before, rel=0.2)
    else:
        assert after < 0.05


def sigma(size):
    return np.asarray(size)[..., None, None] ** 2 * np.eye(2)


def boards_of(model, seed=0, count=6, noise=0.2):
    """Give noisy views (points, pixels) of boards through a fisheye of 180 degrees."""
    return observe_boards(model, 180, np.random.default_rng(seed), count=count, noise=noise)


def test_without_covariances_all_residuals_count_alike():
    views = observe(boards_of(lens(180)))
    assert (ResidualWeights.estimate(estimate_initial_camera(views), views).whitening == np.eye(2)).all()


def test_weighted_residuals_have_one_spread():
    rng = np.random.default_rng(2)
    uncertain = np.zeros((6, 54))
    uncertain[:, ::3] = 1.0
    views = boards_of(lens(180), noise=0.1)
    noise = rng.normal(size=(6, 54, 2)) * uncertain[..., None]
    views = observe([(p, uv + n, sigma(s)) for (p, uv), n, s in zip(views, noise, uncertain, strict=True)])
    state, doubtful = estimate_initial_camera(views), uncertain.ravel() > 0
    roots = ResidualWeights.estimate(state, views).whitening
    lengths = state.lengths(views)
    assert np.median(lengths[doubtful]) > 6 * np.median(lengths[~doubtful])
    lengths = state.lengths(views, roots)
    assert np.median(lengths[doubtful]) == pytest.approx(np.median(lengths[~doubtful]), rel=0.25)
    # What all corners share is found from the residuals: 0.1 px beside the 0 and 1 that are told.
    weight = np.linalg.norm(roots, axis=(1, 2))
    assert weight[~doubtful].min() / weight[doubtful].max() == pytest.approx(np.hypot(1, 0.1) / 0.1, rel=0.25)
    np.testing.assert_allclose(roots[doubtful], roots[doubtful][:1].repeat(doubtful.sum(), 0))


def test_a_doubt_in_one_direction_leaves_the_other():
    views = boards_of(lens(180), noise=0.1)
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    one_way = turn @ np.diag([1.0, 0.0]) @ turn.T
    own = np.tile(one_way, (54, 1, 1)) * (np.arange(54) % 5 == 0)[:, None, None]
    views = observe([(*view, own) for view in views])
    roots = ResidualWeights.estimate(estimate_initial_camera(views), views).whitening
    along, across = (np.linalg.norm(roots @ turn[:, k], axis=1) for k in (0, 1))
    doubtful = np.arange(len(roots)) % 54 % 5 == 0
    assert (along[doubtful] < 0.2 * across[doubtful]).all()
    np.testing.assert_allclose(along[~doubtful], across[~doubtful])
    np.testing.assert_allclose(across[doubtful], across[~doubtful][0])


def test_honest_covariances_bring_the_camera_nearer_to_the_truth():
    """A quarter of the corners ten times as noisy as the others, and saying so."""
    truth = lens(180)
    told, untold = [], []
    for seed in range(6):
        views, rng = [], np.random.default_rng(100 + seed)
        for points, pixels in boards_of(truth, seed, noise=0.0):
            weights = np.where(rng.random(len(points)) < 0.25, 1.0, 0.1)
            views.append((points, pixels + rng.normal(size=pixels.shape) * weights[:, None], sigma(weights)))
        for errors_, given in ((told, views), (untold, [view[:2] for view in views])):
            all_views = observe(given)
            found = refine(resect(truth, all_views), all_views).state.model
            errors_.append(bearing_error(found, truth, np.radians(85)))
    assert np.mean(told) < 0.8 * np.mean(untold)
