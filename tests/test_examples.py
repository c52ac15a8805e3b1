"""Every example runs, writes its files and prints what its page in the documentation shows."""

import importlib.util
from pathlib import Path

import pytest

from omnisight.images import read_image

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples"
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


@pytest.fixture(scope="module")
def make_examples():
    """Return the module `docs/make_examples.py`."""
    spec = importlib.util.spec_from_file_location("make_examples", ROOT / "docs" / "make_examples.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_and_prints_what_its_page_shows(path, tmp_path, make_examples):
    if "import torch" in path.read_text() and importlib.util.find_spec("torch") is None:
        pytest.skip("needs the extra torch")
    printed = make_examples.run_example(path, tmp_path)
    files, output = EXPECTED[path.stem]
    assert files <= {file.name for file in tmp_path.iterdir()}
    assert output in printed
    shown = {name for row in make_examples.IMAGES.get(path.stem, ()) for name in row}
    assert shown <= {file.name for file in tmp_path.iterdir()}
    for image in tmp_path.glob("*.jpg"):
        assert read_image(image).std() > 20, f"{image.name} is blank"
    stored = (make_examples.OUTPUTS / f"{path.stem}.txt").read_text(encoding="utf-8")
    assert not make_examples.differing_lines(stored, printed), "run: python docs/make_examples.py"


def test_the_page_has_outputs_and_small_images_of_the_examples(make_examples):
    stored = {path.name: path.stat().st_size for path in make_examples.OUTPUTS.iterdir()}
    images = {f"{name}.jpg" for name in make_examples.IMAGES}
    assert set(stored) == images | {f"{path.stem}.txt" for path in EXAMPLES}
    assert max(stored[name] for name in images) < make_examples.MAX_BYTES


@pytest.mark.parametrize(
    ("old", "new", "is_equal"),
    [
        ("map: 30 ms, 2.00 px", "map: 75 ms,  2.01 px", True),
        ("[-0.5  1.]", "[ -0.5   1.]", True),
        ("2.00 px", "2.20 px", False),
        ("2.00 px", "2.00 deg", False),
        ("8 of 8 images", "7 of 8 images", False),
        ("a\nb", "a", False),
    ],
)
def test_lines_are_compared_up_to_times_spaces_and_small_changes(old, new, is_equal, make_examples):
    assert (not make_examples.differing_lines(old, new)) == is_equal


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_is_short_and_has_a_docstring(path):
    text = path.read_text()
    assert text.startswith('"""')
    assert len(text.splitlines()) < 40
