"""Images that repeat an earlier one, compared with all pairs."""

import numpy as np
import pytest

from omnisight.targets.detections import Detection
from omnisight.targets.duplicates import find_duplicates
from pace import assert_quick

SIZE = (1600, 1200)  # points that move by less than 10 px repeat an image


def board(ids, pixels):
    return Detection(np.asarray(ids), np.asarray(pixels, float), np.zeros((len(ids), 2, 2)))


def movement(boards, others):
    """Return the largest movement of a point, without NumPy."""
    if len(boards) != len(others) or not boards:
        return np.inf
    farthest = 0.0
    for one, other in zip(boards, others, strict=True):
        here, there = (dict(zip(d.ids.tolist(), d.pixels.tolist(), strict=True)) for d in (one, other))
        common = here.keys() & there.keys()
        if not common or len(common) < 0.8 * max(len(here), len(there)):
            return np.inf
        farthest = max(farthest, *(np.hypot(*np.subtract(here[i], there[i])) for i in common))
    return farthest


def by_all_pairs(images):
    found = {}
    for i, boards in enumerate(images):
        moved, j = min(((movement(boards, images[j]), j) for j in range(i) if j not in found), default=(np.inf, 0))
        if moved < 10:
            found[i] = (j, moved)
    return found


@pytest.mark.parametrize("points", [1, 4, 5, 35])
def test_the_same_are_found_as_in_all_pairs(points):
    rng = np.random.default_rng(points)
    places = rng.uniform(100, 1100, (12, points, 2))
    images = []
    for _ in range(150):
        boards = []
        for k in rng.integers(0, 12, rng.integers(0, 3)):
            ids = np.flatnonzero(rng.random(points) < 0.95)
            boards.append(board(ids, (places[k] + rng.normal(0, 3, 2) + rng.normal(0, 1.5, (points, 2)))[ids]))
        images.append(boards)
    found, expected = find_duplicates(images, SIZE), by_all_pairs(images)
    assert 10 < len(expected) < 120
    assert {i: j for i, (j, _) in found.items()} == {i: j for i, (j, _) in expected.items()}
    assert all(moved == pytest.approx(expected[i][1], abs=1e-9) for i, (_, moved) in found.items())


def test_points_that_other_images_lack():
    pixels = np.random.default_rng(0).uniform(100, 1100, (10, 2))
    whole = [board(range(10), pixels)]
    assert find_duplicates([whole, [board(range(2, 10), pixels[2:])]], SIZE) == {1: (0, 0.0)}
    assert find_duplicates([[board(range(2, 10), pixels[2:])], whole], SIZE) == {1: (0, 0.0)}
    assert find_duplicates([whole, [board(range(3, 10), pixels[3:])]], SIZE) == {}


def test_images_without_boards_or_points_repeat_none():
    assert find_duplicates([[], [], [board([], np.zeros((0, 2)))], [board([], np.zeros((0, 2)))]], SIZE) == {}


def test_many_images_take_linear_time():
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid(np.arange(7), np.arange(5)), -1).reshape(-1, 2)
    images = [
        [board(range(35), corners * rng.uniform(10, 60) + rng.uniform(0, 1000, 2) + rng.normal(0, 1, (35, 2)))]
        for _ in range(2000)
    ]
    assert_quick(lambda: find_duplicates(images, SIZE), 40)
