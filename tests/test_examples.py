"""Every example runs, writes its files and prints its result."""

import runpy
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from omnisight.images import read_image

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("[0-9]*.py"))

# The files that each example writes, and a part of its output.
EXPECTED = {
    "01_bearings": ({"fisheye.json"}, "valid: True"),
    "02_calibrate": ({"camera.json"}, "8 of 8 images"),
    "03_panorama": ({"ahead.jpg", "panini.jpg", "sphere.jpg", "cylinder.jpg"}, "sphere: 1600x800"),
    "04_mirror": ({"mirror.jpg", "cylinder.jpg", "front.jpg", "planet.jpg"}, "flip = False"),
    "05_convert": ({"fisheye.native.json"}, "kannala_brandt as ocam"),
    "06_video_remapper": ({"last.jpg"}, "fps"),
    "07_mirror_dimensions": ({"parabola.json", "hyperbola.json", "ellipse.json"}, "xi = 0.95135"),
    "08_rig": (
        {"pair.json", "pair.jpg", "pair-back.jpg", "ring.json", "ring.jpg", "ring-cam4.jpg"},
        "cover 100.0 % of",
    ),
    "10_notebook": ({"map.npy", "camera.html"}, "the cameras are the same within their uncertainties"),
    "09_surround": ({"car.json", "front.jpg", "right.jpg", "back.jpg", "left.jpg", "above.jpg"}, "98 % of the ground"),
    "11_refine_photometrically": ({"first.jpg"}, "step 99: error of the projection 0."),
    "12_training_data": ({"0.jpg", "3.jpg"}, "learned: True"),
}


def test_every_example_is_listed():
    assert {path.stem for path in EXAMPLES} == set(EXPECTED)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(path, tmp_path, monkeypatch, capsys):
    if "import torch" in path.read_text() and find_spec("torch") is None:
        pytest.skip("needs the extra torch")
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path)])
    runpy.run_path(str(path), run_name="__main__")
    files, output = EXPECTED[path.stem]
    assert files <= {file.name for file in tmp_path.iterdir()}
    assert output in capsys.readouterr().out
    for image in tmp_path.glob("*.jpg"):
        assert read_image(image).std() > 20, f"{image.name} is blank"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short_and_has_a_docstring(path):
    text = path.read_text()
    assert text.startswith('"""')
    assert len(text.splitlines()) < 40
