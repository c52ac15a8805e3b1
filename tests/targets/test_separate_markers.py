"""Corners of separate markers match the rendered truth, without bias and with true covariances."""

import cv2
import numpy as np
import pytest

from omnisight.targets.boards.aruco_grid import ArucoGrid
from omnisight.targets.detectors import detect, measure, separate_markers
from prints import APRIL, ARUCO_GRID, SIZE, pose, projector, render, texture

NARROW = ArucoGrid(6, 4, marker=0.0216, separation=0.0036, dictionary="DICT_4X4_50")


def normalized_error(found, truth):
    """Return the mean of the squared errors over their variances: 1 where the covariance is right."""
    error = found.pixels - truth[found.ids]
    return (np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error) / 2).mean()


@pytest.mark.parametrize("board", [ARUCO_GRID, NARROW], ids=str)
@pytest.mark.parametrize(
    ("lens", "angle", "distance"),
    [("fisheye", 0, 0.17), ("fisheye", 60, 0.17), ("fisheye", 85, 0.12), ("mirror", 30, 0.17), ("mirror", 85, 0.14)],
)
def test_corners_match_the_truth(board, lens, angle, distance):
    image, truth = render(board, lens, pose(board, angle, distance=distance))
    (found,) = detect(image, board)
    inside = ((truth > 5) & (truth < np.array(SIZE) - 6)).all(axis=1).reshape(-1, 4).all(axis=1)
    assert len(found) >= 0.9 * 4 * inside.sum()
    error = found.pixels - truth[found.ids]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.1
    assert 0.5 < normalized_error(found, truth) < 2
    # A wrong gray level or width of an edge makes all markers larger or smaller.
    corners = truth.reshape(-1, 4, 2)
    outward = (corners - corners.mean(axis=1, keepdims=True)).reshape(-1, 2)[found.ids]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert abs((error * outward).sum(axis=1).mean()) < 0.03
    assert np.abs(error.mean(axis=0)).max() < 0.03


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_mirrored_and_inverted_prints_are_detected(mirrored, inverted):
    image, truth = render(ARUCO_GRID, "fisheye", pose(ARUCO_GRID, 40), mirrored=mirrored)
    (found,) = detect(255 - image if inverted else image, ARUCO_GRID)
    assert len(found) == ARUCO_GRID.size
    assert np.linalg.norm(found.pixels - truth[found.ids], axis=1).max() < 0.3


def test_part_of_a_board_has_the_right_ids():
    image, truth = render(ARUCO_GRID, "fisheye", pose(ARUCO_GRID, 30))
    middle = int(np.median(truth[:, 0]))
    (found,) = detect(np.ascontiguousarray(image[:, middle:]), ARUCO_GRID)
    assert 16 <= len(found) < ARUCO_GRID.size
    assert np.linalg.norm(found.pixels - (truth - (middle, 0))[found.ids], axis=1).max() < 0.4


def test_a_board_of_which_one_column_of_points_is_visible_is_left_out():
    image = cv2.GaussianBlur(texture(ARUCO_GRID, 2000.0)[0], (0, 0), 1.0)
    cut = np.ascontiguousarray(image[:, :62])
    (found,) = separate_markers.detect(cut, ARUCO_GRID)
    assert np.ptp(ARUCO_GRID.points[found.ids, 0]) == 0
    assert detect(cut, ARUCO_GRID) == []


def test_markers_with_cells_below_two_pixels_are_left_out():
    image, truth = render(ARUCO_GRID, "fisheye", pose(ARUCO_GRID, 30, distance=0.35))
    side = np.linalg.norm(truth[0::4] - truth[1::4], axis=1)
    assert side.min() < 16 < side.max()
    for found in detect(image, ARUCO_GRID):
        assert side[found.ids // 4].min() > 15


def test_points_are_measured_near_predicted_pixels():
    placed = pose(ARUCO_GRID, 50)
    image, truth = render(ARUCO_GRID, "fisheye", placed)
    start = projector("fisheye", placed)(ARUCO_GRID.points) + 0.5
    start[:4] = np.nan
    measured = measure(image, ARUCO_GRID, start, *np.zeros((2, len(start), 2, 2)))
    assert np.isnan(measured.pixels[:4]).all()
    assert np.sqrt(((measured.pixels - truth)[4:] ** 2).sum(axis=1).mean()) < 0.1
    assert (measured.amplitude[4:] > 0).all()


def test_other_boards_and_noise_are_not_detected():
    assert detect(render(APRIL, "fisheye", pose(APRIL, 0))[0], ARUCO_GRID) == []
    assert detect(render(ARUCO_GRID, "fisheye", pose(ARUCO_GRID, 0))[0], NARROW) == []
    noise = np.random.default_rng(0).integers(0, 256, (200, 300), dtype=np.uint8)
    assert detect(noise, ARUCO_GRID) == []
