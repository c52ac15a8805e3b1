"""Undistorted copies among the images of a set are left out; images of a second camera are not."""

from pathlib import Path

import numpy as np
import pytest

from drawn import CENTRE, FOCAL, SIZE, pose, project
from omnisight.targets import Checkerboard, Detection, ImageDetection
from omnisight.targets.undistorted_copies import leave_out_undistorted_copies

BOARD = Checkerboard(9, 6)
VIEWS = [(12 * k - 25, 9 * (k % 3) - 9, 40 * k, 6 + 2 * (k % 3)) for k in range(6)]


def pinhole(points):
    return CENTRE + 0.6 * FOCAL * points[:, :2] / points[:, 2:]


def image(name, pixels, rng):
    pixels = pixels + rng.normal(0, 0.1, pixels.shape)
    board = Detection(np.arange(BOARD.size), pixels, np.tile(np.eye(2), (BOARD.size, 1, 1)), board=BOARD)
    return ImageDetection(Path(name), SIZE, (board,))


def image_set(second, baseline, names="{}_r.png {}_d.png"):
    """Return images of a fisheye and of a second camera, moved by a baseline, side by side."""
    rng, images = np.random.default_rng(5), []
    for k, view in enumerate(VIEWS):
        rotation, translation = pose(BOARD, *view)
        points = BOARD.points @ rotation.T + translation
        first, other = (name.format(k) for name in names.split())
        images += [image(first, project(points), rng), image(other, second(points + np.array([baseline, 0, 0])), rng)]
    return images


@pytest.mark.parametrize("names", ["{}_r.png {}_d.png", "img{:03}.png img{:03}_undist.png"])
def test_undistorted_copies_are_left_out(names):
    images, notes = leave_out_undistorted_copies(image_set(pinhole, 0.0, names), BOARD)
    assert [bool(image.boards) for image in images] == [True, False] * 6
    assert {image.note for image in images[1::2]} == {"an undistorted copy of another image: left out"}
    assert len(notes) == 1
    assert notes[0].startswith("6 images are undistorted copies of others and are left out: ")


@pytest.mark.parametrize(("second", "baseline"), [(project, 0.0), (project, 3.0), (pinhole, 3.0)])
def test_images_of_a_second_camera_are_kept(second, baseline):
    given = image_set(second, baseline)
    images, notes = leave_out_undistorted_copies(given, BOARD)
    assert images == given
    assert notes == []


@pytest.mark.slow
def test_copies_in_a_real_folder_are_left_out(data):
    from omnisight.targets import detect_boards

    found = detect_boards(sorted((data("everyday") / "own_results").glob("*.jpg")))
    assert {image.path.stem[-2:] for image in found.found} == {"_r", "on"}
    assert len(found.found) == 11
