"""Several boards in one image: further printed boards count, boards on a monitor do not."""

from pathlib import Path

import numpy as np
import pytest

import omnisight as om
from drawn import SIZE, pose, project
from omnisight.calibration.board_consistency import leave_out_inconsistent_boards
from omnisight.targets import Checkerboard, Detection, Detections, ImageDetection

BOARD = Checkerboard(9, 6)
NOISE_PX = 0.1
# Where the first and the further board of the images are held, as `pose` takes it; some further ones are at the rim.
FIRST = [(5 * k - 20, 6 * (k % 4) - 9, 37 * k, 7 + k % 3) for k in range(8)]
FURTHER = [(55 * (-1) ** k, 4 * k - 12, 53 * k, 9) for k in range(8)]


def seen(where, board_points, rng):
    rotation, translation = pose(BOARD, *where)
    pixels = project(board_points @ rotation.T + translation) + rng.normal(0, NOISE_PX, (BOARD.size, 2))
    return Detection(np.arange(BOARD.size), pixels, np.tile(np.eye(2) * NOISE_PX**2, (BOARD.size, 1, 1)), board=BOARD)


def observe(stretch, count=8):
    """Return observations of a printed board and one whose squares are `stretch` times as high, in each image."""
    rng = np.random.default_rng(3)
    further = BOARD.points * (1, stretch, 1)
    images = [
        ImageDetection(Path(f"{k}.png"), SIZE, (seen(FIRST[k], BOARD.points, rng), seen(FURTHER[k], further, rng)))
        for k in range(count)
    ]
    return om.Observations.from_detections(Detections(BOARD, images))


def test_further_printed_boards_are_kept():
    observations = observe(1.0)
    assert leave_out_inconsistent_boards(observations) is observations


@pytest.mark.parametrize("stretch", [0.9, 1.05])
def test_boards_of_another_aspect_are_left_out_with_a_remark(stretch):
    kept = leave_out_inconsistent_boards(observe(stretch))
    assert kept.names == tuple(f"{k}.png" for k in range(8))
    notes = [image.note for image in kept.detections.images]
    assert all(note.startswith("a board left out, not the printed one: rms ") for note in notes)


def test_three_images_are_too_few_to_leave_boards_out():
    observations = observe(0.9, count=3)
    assert leave_out_inconsistent_boards(observations) is observations


@pytest.mark.slow
def test_boards_on_a_monitor_are_left_out(data):
    calibration = om.calibrate(data("everyday") / "opencv_left")
    assert calibration.rms < 0.16
    assert len(calibration.observations) == 13
