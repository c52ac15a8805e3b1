"""The section of the report about the non-central test."""

from dataclasses import replace

import pytest

from omnisight.report.page import render_page
from reporting import section, with_quality


@pytest.fixture(scope="module")
def result(central):
    return central.noncentral_test


def test_section_has_result_chart_and_table(central, result):
    text = section(render_page(central), "noncentral-test")
    assert str(result)[1:] in text
    assert "How to read this" in text
    assert text.count('class="line ') >= 6
    for k in range(3):
        assert result.distance(k) in text
        assert f"{result.central_error.max_pixels[k]:.3f}" in text


@pytest.mark.parametrize("is_noncentral", [True, False])
def test_axial_model_is_recommended_if_the_camera_is_noncentral(central, result, is_noncentral):
    data = with_quality(central, noncentrality=replace(result, is_noncentral=is_noncentral, doubt=""))
    assert ("Calibrate with --model axial" in render_page(data)) == is_noncentral


def test_section_is_omitted_without_test(central):
    assert 'id="noncentral-test"' not in render_page(with_quality(central, noncentrality=None))
