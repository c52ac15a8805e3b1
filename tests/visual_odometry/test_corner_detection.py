"""Corners are those of OpenCV: the best local maximum of the smaller eigenvalue in each cell without a patch."""

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.simulation import fisheye_setup
from omnisight.visual_odometry.corner_detection import MIN_EIGENVALUE, detect_corners
from omnisight.visual_odometry.solid_angle_cells import SolidAngleCells

CAMERA = fisheye_setup(320).camera
INNER = np.zeros(CAMERA.size[::-1], np.bool_)
INNER[12:-12, 12:-12] = True


@pytest.fixture(scope="module")
def image():
    return om.images.to_gray8(fisheye_setup(320).renderer(samples=1)().image)


def expected(gray, cells, occupied):
    """Return the best corner of each cell by OpenCV, whose derivatives are 8 x 9 x 255 / 2 times smaller."""
    score = cv2.cornerMinEigenVal(gray, 9, ksize=3) * (255.0 * 9 / 2) ** 2
    is_peak = (score >= cv2.dilate(score, np.ones((15, 15), np.uint8))) & (score > MIN_EIGENVALUE)
    held = set(cells.at(occupied).tolist()) if len(occupied) else set()
    for u, v in np.rint(occupied).astype(int):
        is_peak[max(v - 7, 0) : v + 8, max(u - 7, 0) : u + 8] = False
    best = {}
    for row, column in zip(*np.nonzero(is_peak), strict=True):
        cell = int(cells.of_pixel[row, column])
        if cell >= 0 and cell not in held and score[row, column] > best.get(cell, (0.0,))[0]:
            best[cell] = score[row, column], (column, row)
    return [best[cell][1] for cell in sorted(best)]


@pytest.mark.parametrize("count", [0, 40])
def test_corners_are_those_of_opencv(image, count):
    cells = SolidAngleCells.of(CAMERA, INNER, 200)
    occupied = detect_corners(image, cells, np.zeros((0, 2)))[: 2 * count : 2] + 0.3
    corners = detect_corners(image, cells, occupied)
    assert len(corners) > 20
    np.testing.assert_array_equal(corners, expected(image, cells, occupied))


def test_corners_do_not_depend_on_the_number_of_threads(image, monkeypatch):
    cells, found = SolidAngleCells.of(CAMERA, INNER, 200), []
    large = np.tile(image, (4, 1))
    wide = SolidAngleCells(np.tile(cells.of_pixel, (4, 1)), cells.count, cells.used)
    for threads in ("1", "2"):
        monkeypatch.setenv("OMNISIGHT_THREADS", threads)
        found.append(detect_corners(large, wide, np.zeros((0, 2))))
    assert len(found[0])
    np.testing.assert_array_equal(*found)


def test_an_image_of_noise_or_of_one_edge_has_no_corner():
    cells = SolidAngleCells.of(CAMERA, INNER, 200)
    noise = np.random.default_rng(0).normal(128.0, 2.0, INNER.shape)
    edge = np.where(np.arange(CAMERA.width) < CAMERA.width // 2, 40, 200) * np.ones(INNER.shape)
    for values in (noise, edge):
        assert not len(detect_corners(np.rint(values).astype(np.uint8), cells, np.zeros((0, 2))))
