"""Patterns of file names that divide the images of several cameras."""

import pytest

from omnisight.images.name_patterns import patterns_by_name
from omnisight.targets.image_sizes import sizes_note


@pytest.mark.parametrize(
    ("form", "patterns"),
    [
        ("{side}{i}.jpg", ("left*.jpg", "right*.jpg")),
        ("{i:02}_{side}.png", ("*_left.png", "*_right.png")),
        ("img_{camera}_{i}.png", ("img_0_*.png", "img_1_*.png")),
        ("{i}-cam{camera}.png", ("*-cam0.png", "*-cam1.png")),
        ("{side}/{i}.png", ("left/*.png", "right/*.png")),
    ],
)
def test_two_cameras(form, patterns):
    shots = [(camera, i) for i in range(10, 14) for camera in (0, 1)]
    names = [form.format(side=("left", "right")[camera], camera=camera, i=i) for camera, i in shots]
    assert patterns_by_name(names) == [tuple(patterns[camera] for camera, _ in shots)]


@pytest.mark.parametrize(
    "names",
    [
        [f"img{i}.png" for i in range(9)],
        [f"img{i}.png" for i in range(9)] + ["last1.png"],
        [f"2026_11_{i}.png" for i in range(9)],
        ["a.png", "b.png", "c.png"],
        [],
    ],
)
def test_one_camera(names):
    assert patterns_by_name(names) == []


def test_sizes_that_agree_with_names_are_those_of_cameras():
    sizes = {"cam0": (640, 480), "cam1": (800, 600)}
    images = [(f"{camera}_{i}.png", size) for i in range(4) for camera, size in sizes.items()]
    note = sizes_note(images, (640, 480))
    assert note.endswith("'cam0_*.png', 'cam1_*.png' are different cameras: calibrate each separately")
    images[0] = ("cam0_0.png", (800, 600))
    assert "are different cameras" not in sizes_note(images, (640, 480))
