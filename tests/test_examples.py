"""Every example runs by itself, and leaves what it says."""

import runpy
import sys
from pathlib import Path

import pytest

from omnisight.images import read_image

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("[0-9]*.py"))

# What each must have written and said.
EXPECTED = {
    "01_bearings": ({"fisheye.json"}, "valid: True"),
    "02_calibrate": ({"camera.json"}, "8 of 8 images"),
    "03_panorama": ({"ahead.jpg", "panini.jpg", "sphere.jpg", "cylinder.jpg"}, "sphere: 1600x800"),
    "04_mirror": ({"mirror.jpg", "cylinder.jpg", "front.jpg", "planet.jpg"}, "flip = False"),
    "05_convert": ({"fisheye.native.json"}, "kannala_brandt as ocam"),
    "06_video_remapper": ({"last.jpg"}, "fps"),
    "07_mirror_dimensions": ({"parabola.json", "hyperbola.json", "ellipse.json"}, "xi = 0.95135"),
    "08_rig": ({"pair.json", "pair.jpg", "pair-back.jpg", "ring.json", "ring.jpg", "ring-cam4.jpg"}, "see 100.0 % of"),
    "09_surround": ({"car.json", "front.jpg", "right.jpg", "back.jpg", "left.jpg", "above.jpg"}, "98 % of the ground"),
}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path)])
    runpy.run_path(str(path), run_name="__main__")
    files, said = EXPECTED[path.stem]
    assert files <= {file.name for file in tmp_path.iterdir()}
    assert said in capsys.readouterr().out
    for picture in tmp_path.glob("*.jpg"):
        assert read_image(picture).std() > 20, f"{picture.name} shows nothing"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_is_short_and_says_what_it_shows(path):
    text = path.read_text()
    assert text.startswith('"""')
    assert len(text.splitlines()) < 40
