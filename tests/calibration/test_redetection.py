"""The re-detection pass: corners predicted by a first camera are added, measured again, or dropped."""

import os
import time
from dataclasses import replace

import numpy as np
import pytest

from calibrating import calibrate
from lenses import bearing_error
from omnisight.calibration import redetection
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.redetection import FAR_DEG, RedetectionStats, redetect
from omnisight.images import read_image, write_image
from omnisight.simulation import fisheye_setup
from omnisight.targets import Checkerboard, detect_boards
from omnisight.targets.observations import Observations
from prints import CIRCLES, pose, render

BOARD = Checkerboard(9, 6, 0.04)
COUNT, WIDTH = 6, 640
FAR_RAD = np.radians(FAR_DEG)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Images of a board through a fisheye of 190 degrees, the true corners, and their angles from the axis."""
    folder = tmp_path_factory.mktemp("scenes")
    setup = fisheye_setup(WIDTH)
    renderer, truth, angles = setup.renderer(), [], []
    for i, board in enumerate(setup.boards(COUNT, BOARD)):
        rendered = renderer([board], np.random.default_rng(i))
        write_image(folder / f"{i}.png", rendered.image)
        truth.append(rendered.corners[0])
        points = board.cam_from_board @ BOARD.points
        angles.append(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))
    return sorted(folder.glob("*.png")), np.array(truth), np.array(angles)


@pytest.fixture(scope="module")
def detections(scenes):
    """The first detections, which have all corners."""
    first = detect_boards(scenes[0], BOARD, cache=False)
    assert [len(image.detection) for image in first.images] == [BOARD.size] * COUNT
    return first


def with_ids(detection, ids):
    """Return the part of a detection with some corner ids."""
    kept = np.isin(detection.ids, ids)
    return replace(
        detection, ids=detection.ids[kept], pixels=detection.pixels[kept], covariance=detection.covariance[kept]
    )


def with_boards(detections, change):
    """Return detections with the boards `change(image index, detection)`, a tuple, in each image."""
    images = [replace(image, boards=change(i, image.detection)) for i, image in enumerate(detections.images)]
    return replace(detections, images=images)


def run_redetection(detections, **options):
    """Return the detections of the second pass and its statistics."""
    observations = Observations.from_detections(detections)
    redetected, stats = redetect(observations, estimate_initial_camera(observations), **options)
    return redetected.detections, stats


def errors(detections, truth):
    """Return the errors (N, 2) of the corners of all images, px."""
    images = enumerate(detections.images)
    return np.concatenate([board.pixels - truth[i][board.ids] for i, image in images for board in image.boards])


def rms(error):
    return float(np.sqrt((error**2).sum(axis=1).mean()))


@pytest.mark.parametrize("processors", [1, 8])
def test_the_number_of_processors_does_not_change_which_images_are_searched(detections, monkeypatch, processors):
    def search(*_):
        calls.append(1)
        time.sleep(0.05)

    calls = []
    monkeypatch.setattr(redetection, "_detect_in_views", search)
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    others = [replace(image, boards=()) for image in detections.images]
    run_redetection(replace(detections, images=[*detections.images[:3], *others, *others, *others]))
    assert len(calls) == redetection.MAX_FAILURES


def test_complete_detections_are_measured_more_precisely(detections, scenes):
    calls = []
    second, stats = run_redetection(detections, progress=lambda *call: calls.append(call))
    assert (stats.corners, stats.far, stats.dropped, stats.boards) == (0, 0, 0, 0)
    before, after = errors(detections, scenes[1]), errors(second, scenes[1])
    assert rms(after) < rms(before) < 0.02
    assert np.abs(after).max() < 0.05
    assert calls == [("re-detect", i + 1, COUNT) for i in range(COUNT)]
    assert [p.path for p in second.images] == [p.path for p in detections.images]


@pytest.mark.parametrize("kept", ["every second", "half a board", "all but the border", "few"])
def test_missed_corners_are_added(detections, scenes, kept):
    _, truth, angles = scenes
    rng = np.random.default_rng(0)
    row, column = np.divmod(np.arange(BOARD.size), BOARD.columns)

    def part(i):
        match kept:
            case "every second":
                return np.flatnonzero((row + column + i) % 2)
            case "half a board":
                return np.flatnonzero(column < 5) if i % 2 else np.flatnonzero(row > 2)
            case "all but the border":
                return np.flatnonzero(angles[i] < np.quantile(angles[i], 0.7))
        return np.sort(rng.permutation(BOARD.size)[:14])

    parts = [part(i) for i in range(COUNT)]
    reduced = with_boards(detections, lambda i, d: (with_ids(d, parts[i]),))
    second, stats = run_redetection(reduced)
    missing = [np.setdiff1d(np.arange(BOARD.size), ids) for ids in parts]
    assert stats.corners == sum(map(len, missing))
    assert stats.far == sum(int((angles[i][ids] > FAR_RAD).sum()) for i, ids in enumerate(missing))
    assert stats.far > 0
    assert (stats.dropped, stats.boards) == (0, 0)
    assert [p.detection.ids.tolist() for p in second.images] == [list(range(BOARD.size))] * COUNT
    assert rms(errors(second, truth)) < min(0.015, rms(errors(reduced, truth)) * 1.05)
    assert all(
        len(p.detection) == len(ids) for p, ids in zip(reduced.images, parts, strict=True)
    )  # the input is not modified


def test_notes_are_updated(detections):
    reduced = with_boards(detections, lambda i, d: (with_ids(d, range(40)),))
    reduced = replace(reduced, images=[p.with_boards(p.boards, BOARD).with_remark("old") for p in reduced.images])
    assert {p.note for p in reduced.images} == {"40 of 54 corners; old"}
    second, _ = run_redetection(reduced)
    assert {p.note for p in second.images} == {"old"}


@pytest.mark.parametrize("missed", [(0,), (2, 4)])
def test_missed_boards_are_detected_in_perspective_views(detections, scenes, missed):
    _, truth, _ = scenes
    reduced = with_boards(detections, lambda i, d: () if i in missed else (d,))
    second, stats = run_redetection(reduced)
    assert stats.boards == len(missed)
    assert stats.corners == sum(len(second.images[i].detection) for i in missed)
    assert rms(errors(second, truth)) < 0.02
    assert ["perspective view" in p.note for p in second.images] == [i in missed for i in range(COUNT)]


@pytest.mark.parametrize("missed", [4, 5])
def test_boards_detected_in_perspective_views_are_complete(detections, missed):
    _, stats = run_redetection(with_boards(detections, lambda i, d: () if i == missed else (d,)))
    assert stats.corners == BOARD.size


def test_far_corners_of_perspective_views_are_counted(detections, scenes):
    second, stats = run_redetection(with_boards(detections, lambda i, d: () if i == 0 else (d,)))
    assert stats.far == int((scenes[2][0][second.images[0].detection.ids] > FAR_RAD).sum()) > 0


def test_ambiguous_position_of_a_partial_board_is_resolved(detections):
    """Further corners are visible at one of the possible positions only."""

    def part(i, d):
        middle = with_ids(d, np.flatnonzero(np.isin(np.arange(BOARD.size) % BOARD.columns, range(3, 8))))
        return (replace(middle, ids=middle.ids - 2, located=False),) if i == 1 else (d,)

    first = with_boards(detections, part)
    second, _ = run_redetection(first)
    assert second.images[1].detection.located
    assert second.images[1].detection.ids.tolist() == list(range(BOARD.size))
    np.testing.assert_allclose(second.images[1].detection.pixels, detections.images[1].detection.pixels, atol=0.1)


def test_image_without_a_board_stays_without_one(detections, tmp_path):
    gray = np.random.default_rng(0).normal(110, 3, (480, 640))
    write_image(tmp_path / "empty.png", gray.astype(np.uint8))
    extended = replace(
        detections, images=[*detections.images, *detect_boards([tmp_path / "empty.png"], BOARD, cache=False).images]
    )
    (tmp_path / "bad.png").write_bytes(b"no image")
    extended = replace(
        extended, images=[*extended.images, *detect_boards([tmp_path / "bad.png"], BOARD, cache=False).images]
    )
    second, stats = run_redetection(extended)
    assert stats.boards == 0
    assert second.images[COUNT:] == extended.images[COUNT:]


@pytest.fixture(scope="module")
def occluded(scenes, tmp_path_factory):
    """The images with a patch over four corners, and the ids of the corners well under it."""
    folder, covered = tmp_path_factory.mktemp("occluded"), []
    for path, truth in zip(*scenes[:2], strict=True):
        image = read_image(path).copy()
        hidden = truth[[21, 22, 30, 31]]
        (left, top), (right, bottom) = hidden.min(0).astype(int) - 4, hidden.max(0).astype(int) + 5
        image[top:bottom, left:right] = 130
        covered.append(np.flatnonzero(((truth > (left + 2, top + 2)) & (truth < (right - 3, bottom - 3))).all(axis=1)))
        write_image(folder / path.name, image)
    return sorted(folder.glob("*.png")), covered


def test_occluded_corners_are_not_added(occluded, scenes):
    paths, covered = occluded
    first = detect_boards(paths, BOARD, cache=False)
    assert len(first.images) == len(covered) > 0
    assert min(map(len, covered)) >= 4
    assert all(len(p.boards) == 1 for p in first.images)
    second, stats = run_redetection(first)
    assert not any(np.isin(ids, p.detection.ids).any() for p, ids in zip(second.images, covered, strict=True))
    assert all(len(p.detection) > 45 for p in second.images)
    assert stats.dropped == 0
    # The edge of the patch disturbs adjacent corners only.
    error = np.linalg.norm(errors(second, scenes[1]), axis=1)
    assert np.median(error) < 0.01
    assert error.max() < 1.5


def redetect_occluded(detections, paths, ids):
    """Start from detections of all corners in images that hide some; return the second pass and the hidden ids kept."""
    first = replace(
        detections, images=[replace(p, path=path) for p, path in zip(detections.images, paths, strict=True)]
    )
    second, stats = run_redetection(first)
    return second, stats, [np.intersect1d(each, p.detection.ids) for p, each in zip(second.images, ids, strict=True)]


def test_false_corners_are_dropped(detections, occluded):
    second, stats, kept = redetect_occluded(detections, *occluded)
    count = sum(map(len, occluded[1]))
    assert stats.dropped >= count - sum(map(len, kept)) > 0.8 * count
    assert stats.corners == 0
    assert all(len(p.detection) > 44 for p in second.images)


def test_no_occluded_corner_is_kept(detections, occluded):
    *_, kept = redetect_occluded(detections, *occluded)
    assert not any(map(len, kept))


def test_displaced_corners_are_measured_again(detections, scenes):
    rng = np.random.default_rng(1)

    def displaced(i, d):
        pixels = d.pixels.copy()
        pixels[rng.permutation(BOARD.size)[:3]] += rng.choice([-1, 1], (3, 2)) * 1.5
        return (replace(d, pixels=pixels),)

    first = with_boards(detections, displaced)
    second, stats = run_redetection(first)
    assert rms(errors(first, scenes[1])) > 0.4
    assert rms(errors(second, scenes[1])) < 0.015
    assert stats.dropped == 0


def test_calibrate_includes_the_redetection_pass(detections, scenes):
    reduced = with_boards(detections, lambda i, d: () if i == 3 else (with_ids(d, np.arange(0, BOARD.size, 2)),))
    result = calibrate(reduced, model="kannala_brandt")
    assert result.redetection.corners == COUNT * BOARD.size - (COUNT - 1) * 27
    assert result.redetection.boards == 1
    assert len(result.observations) == len(result.observations.detections.found) == COUNT
    assert len(result.observations.pixels) == COUNT * BOARD.size
    assert result.rms < 0.03
    truth = fisheye_setup(WIDTH).camera
    assert bearing_error(result.camera, truth.model, np.radians(88)) < 0.05


def test_statistics_are_printed_in_one_line():
    assert str(RedetectionStats(214, 96)) == "+214 corners (96 beyond 80° off-axis)"
    assert str(RedetectionStats(214, 96, 0, 3)) == "+214 corners (96 beyond 80° off-axis), +3 boards"
    assert str(RedetectionStats(5, 0, 2)) == "+5 corners (0 beyond 80° off-axis), 2 not confirmed"
    assert RedetectionStats(1, 2, 3, 4) + RedetectionStats(10, 20, 30, 40) == RedetectionStats(11, 22, 33, 44)


@pytest.fixture(scope="module")
def discs(tmp_path_factory):
    """The first detections in images of a board of discs, and the true projections of their centres."""
    folder, truth = tmp_path_factory.mktemp("discs"), []
    for i, (angle, azimuth) in enumerate(((5, 0), (50, 170), (55, 10))):
        image, centres = render(CIRCLES, "fisheye", pose(CIRCLES, angle, azimuth=azimuth, distance=0.14), seed=i)
        write_image(folder / f"{i}.png", image)
        truth.append(centres)
    first = detect_boards(sorted(folder.glob("*.png")), CIRCLES, cache=False)
    assert [len(p.detection) for p in first.images] == [CIRCLES.size] * len(truth)
    return first, truth


@pytest.mark.parametrize("board", [CIRCLES, replace(CIRCLES, diameter=None)], ids=["known", "unknown"])
def test_centres_of_discs_are_corrected_if_the_diameter_is_known(board, discs):
    first, truth = replace(discs[0], board=board), discs[1]
    reduced = with_boards(first, lambda i, d: (with_ids(d, np.arange(0, board.size, 2)),))
    second, stats = run_redetection(reduced)
    assert stats.corners == len(truth) * board.size / 2
    assert [len(p.detection) for p in second.images] == [board.size] * len(truth)
    before, after = rms(errors(first, truth)), rms(errors(second, truth))
    assert before > 0.3
    if board.diameter is None:
        assert after == pytest.approx(before, rel=0.2)
    else:
        assert after < 0.05
