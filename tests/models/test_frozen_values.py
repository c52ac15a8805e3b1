"""Cameras compared with values of other implementations, which `frozen/make_frozen.py` computed."""

import json
from pathlib import Path

import numpy as np
import pytest

from omnisight.models import model_class

FILES = sorted((Path(__file__).parent / "frozen").glob("*.json"))
CASES = [
    pytest.param(case, id=f"{file.stem}-{i}-{case['model']}")
    for file in FILES
    for i, case in enumerate(json.loads(file.read_text())["cases"])
]


def test_every_source_is_present():
    assert [file.stem for file in FILES] == ["colmap", "ocamcalib", "opencv", "scipy"]
    for file in FILES:
        frozen = json.loads(file.read_text())
        assert frozen["source"]
        assert "default_rng" in frozen["made"]


@pytest.mark.parametrize("case", CASES)
def test_pixels_agree_with_the_other_implementation(case):
    model = model_class(case["model"]).from_dict(case["params"])
    points, expected = np.array(case["points"]), np.array(case["pixels"])
    pixels, valid = model.project(points)
    assert valid.all()
    np.testing.assert_allclose(pixels, expected, rtol=1e-12, atol=case["tolerance_px"])


@pytest.mark.parametrize("case", CASES)
def test_pixels_of_the_other_implementation_unproject_to_its_directions(case):
    model = model_class(case["model"]).from_dict(case["params"])
    points, pixels = np.array(case["points"]), np.array(case["pixels"])
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    bearings, valid, d_pixel, _ = model.unproject_with_jacobians(pixels)
    assert valid.all()
    # By how much a bearing may turn for the pixels to agree.
    allowed = np.linalg.norm(d_pixel, axis=(1, 2)) * case["tolerance_px"] + 1e-11
    assert (np.linalg.norm(bearings - directions, axis=1) < allowed).all()
