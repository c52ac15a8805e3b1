"""Interlaced frames: recognition, and calibration corners on one field."""

import numpy as np
import pytest

from omnisight.images.interlacing import deinterlace, is_interlaced
from omnisight.images.write import write_image
from omnisight.targets import Checkerboard, detect_boards

BOARD = Checkerboard(7, 5)
SQUARE_PX = 40


def frame(shift):
    """Return a smooth image of a checkerboard (400, 480), shifted by some px to the right, and its noise."""
    v, u = np.mgrid[:400, :480].astype(float)
    x, y = (u - 70 - shift + 0.15 * v) / SQUARE_PX, (v - 60 - 0.1 * u) / SQUARE_PX
    inside = (x > 0) & (x < 8) & (y > 0) & (y < 6)
    edge = np.tanh(SQUARE_PX * np.sin(np.pi * x) / 3) * np.tanh(SQUARE_PX * np.sin(np.pi * y) / 3)
    gray = np.where(inside, 130 + 90 * edge, 220)
    return gray + np.random.default_rng(0).normal(0, 2, gray.shape)


def interlaced(shift):
    """Return a frame whose odd rows are exposed later, when the board has moved by some px."""
    result = frame(0)
    result[1::2] = frame(shift)[1::2]
    return result.astype(np.uint8)


def test_moving_boards_are_recognized_and_still_ones_are_not():
    assert is_interlaced(interlaced(4))
    assert not is_interlaced(interlaced(0))


@pytest.mark.parametrize("texture", ["noise", "checks"])
def test_textures_are_not_interlaced(texture):
    gray = np.random.default_rng(1).integers(0, 255, (200, 300)).astype(np.uint8)
    if texture == "checks":
        gray = (255 * (np.indices((200, 300)).sum(0) % 2)).astype(np.uint8)
    assert not is_interlaced(gray)
    assert deinterlace(gray) is gray


@pytest.mark.parametrize("height", [399, 400])
def test_first_field_remains_and_the_second_is_interpolated(height):
    gray = interlaced(4)[:height]
    field = deinterlace(gray)
    np.testing.assert_array_equal(field[::2], gray[::2])
    still = frame(0)[:height]
    assert np.sqrt(((field - still) ** 2).mean()) < 0.4 * np.sqrt(((gray - still) ** 2).mean())


def test_corners_are_those_of_the_first_field_in_pixels_of_the_frame(tmp_path):
    for name, gray in (("moving", interlaced(4)), ("still", interlaced(0))):
        write_image(tmp_path / f"{name}.png", gray)
    moving, still = detect_boards([tmp_path / "moving.png", tmp_path / "still.png"], BOARD, cache=False).images
    assert len(moving.detection) == len(still.detection) == BOARD.size
    order = [np.lexsort(np.round(image.detection.pixels).T) for image in (moving, still)]
    difference = moving.detection.pixels[order[0]] - still.detection.pixels[order[1]]
    assert np.abs(difference.mean(0)).max() < 0.05  # the whole frame has a mean between the fields: 2 px
    assert np.sqrt((difference**2).sum(1).mean()) < 0.2
    assert "interlaced" in moving.note
    assert "interlaced" not in still.note
