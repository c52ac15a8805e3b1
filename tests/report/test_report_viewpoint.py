"""The part of the report on whether rays meet in a point."""

import re
from dataclasses import replace

import pytest

from omnisight.quality.noncentral_test import evaluate_noncentrality
from omnisight.report.page import page


@pytest.fixture(scope="module")
def asked(material):
    return evaluate_noncentrality(material.calibration, unit="m")


def test_it_says_what_was_found_and_draws_it(material, asked):
    text = page(replace(material, asked=asked))
    part = re.search(r'<section id="viewpoint".*?</section>', text, re.DOTALL)[0]
    assert "The rays meet in a point, as far as these images tell" in part
    assert "How to read this" in part
    assert part.count('class="line ') >= 6
    for k in range(3):
        assert asked.distance(k) in part
        assert f"{asked.left.worst_pixels[k]:.3f}" in part


def test_what_to_do_goes_by_what_was_found(material, asked):
    assert "--model axial if you measure nearer" in page(replace(material, asked=replace(asked, needed=True)))
    assert "--model axial if you measure nearer" not in page(replace(material, asked=asked))


def test_there_is_none_where_it_was_not_asked(material):
    assert 'id="viewpoint"' not in page(replace(material, asked=None))
