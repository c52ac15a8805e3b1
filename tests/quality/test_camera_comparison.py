"""Comparison of two cameras: the difference, the test against their uncertainties, the command."""

import dataclasses
import json
import re

import numpy as np
import pytest

import omnisight as om
from omnisight import cli
from omnisight.images import read_image
from omnisight.models import model_class
from omnisight.quality.camera_comparison import CameraComparison
from omnisight.quality.difference_test import chi_square_mixture_tail

LENS = model_class("kannala_brandt")(200.0, 199.0, 321.0, 242.0, 0.02, -0.01, 0.003, -0.001)
# Standard deviations like those of a calibration, with correlations.
ROOT = np.diag([0.2, 0.2, 0.3, 0.3, 2e-3, 3e-3, 2e-3, 5e-4]) @ (np.eye(8) + 0.2)
FISHEYE = om.Camera(LENS, (640, 480), theta_max=1.2, covariance=ROOT @ ROOT.T)


def drawn(rng, size=1.0):
    """Return an estimate of the camera with errors from its covariance."""
    return dataclasses.replace(FISHEYE, model=LENS.with_params(LENS.params + size * ROOT @ rng.normal(size=8)))


@pytest.mark.parametrize("weights", [[1.0], [1.0, 1.0, 1.0], [1.0, 0.3, 0.1, 0.01]])
def test_the_tail_of_a_mixture_of_chi_square_variables_is_that_of_samples(weights):
    rng = np.random.default_rng(0)
    samples = (rng.normal(size=(400_000, len(weights))) ** 2) @ weights
    for probability in (0.5, 0.1, 0.01, 0.003):
        value = np.quantile(samples, 1 - probability)
        tail = chi_square_mixture_tail(float(value), np.array(weights))
        assert tail == pytest.approx(probability, rel=0.2)


def test_p_values_of_estimates_of_one_camera_are_those_of_chance():
    rng = np.random.default_rng(1)
    comparisons = [CameraComparison.of(drawn(rng), drawn(rng), columns=24) for _ in range(200)]
    p = np.sort([c.test.p_value for c in comparisons])
    # The Kolmogorov-Smirnov statistic exceeds 0.107 once in a hundred times. The smaller of two p-values, doubled, is
    # uniform where it is small, and larger elsewhere.
    assert (p - (np.arange(200) + 0.5) / 200).min() > -0.107
    assert np.mean(p < 0.2) > 0.08
    rms = np.sqrt(np.mean([c.rms**2 for c in comparisons]))
    assert rms == pytest.approx(np.mean([c.test.expected_rms for c in comparisons]), rel=0.1)
    assert {c.verdict for c in comparisons} <= {"same", "different"}
    assert np.mean([c.verdict == "same" for c in comparisons]) > 0.95


def test_estimates_with_larger_errors_than_specified_are_different():
    rng = np.random.default_rng(2)
    comparisons = [CameraComparison.of(drawn(rng, 6.0), FISHEYE, columns=24) for _ in range(20)]
    assert sum(c.verdict == "different" for c in comparisons) >= 18
    assert "differ by more than their uncertainties" in max(comparisons, key=lambda c: c.rms).sentence


def test_a_covariance_of_zero_is_an_unknown_uncertainty():
    held = dataclasses.replace(FISHEYE, covariance=np.zeros((8, 8)))
    other = drawn(np.random.default_rng(3))
    comparison = CameraComparison.of(held, other, columns=24)
    assert comparison.uncertainties[0] is None
    assert comparison.uncertainties[1] is not None
    assert "the uncertainty of b:" in comparison.sentence


def test_an_angle_with_too_few_pixels_of_the_grid_is_named():
    with pytest.raises(ValueError, match=r"--max-theta 0.5: \d+ of the pixels of the grid of a .* more --columns"):
        om.compare(FISHEYE, FISHEYE, om.CompareOptions(max_theta=0.5))
    assert om.compare(FISHEYE, FISHEYE, om.CompareOptions(max_theta=0.5, columns=1000)).verdict == "equal"


def test_the_difference_of_two_pinhole_cameras_is_the_closed_form():
    a = om.Camera(model_class("pinhole")(300.0, 300.0, 319.5, 239.5), (640, 480))
    b = om.Camera(model_class("pinhole")(303.0, 303.0, 319.5, 239.5), (640, 480))
    comparison = om.compare(a, b, om.CompareOptions(columns=33))
    u, v = np.meshgrid(comparison.u - 319.5, comparison.v - 239.5)
    expected = np.hypot(u, v) * 0.01
    # The best rotation is none: the difference is symmetric about the axis.
    np.testing.assert_allclose(comparison.rotation, np.eye(3), atol=1e-4)
    np.testing.assert_allclose(comparison.aligned.pixels, expected, atol=0.02)
    np.testing.assert_allclose(comparison.fixed.pixels, expected, atol=1e-9)
    angle = np.abs(np.arctan(np.hypot(u, v) / 300) - np.arctan(np.hypot(u, v) / 303))
    np.testing.assert_allclose(comparison.fixed.angles, angle, atol=1e-9)
    assert comparison.verdict == "unknown"
    assert "no uncertainty" in comparison.sentence
    assert re.match(r"5\d° off-axis at the (upper|lower) (left|right), pixel", comparison.worst_place)


def test_a_rotation_of_the_frame_is_no_difference():
    # An equirectangular image that starts at another longitude is the same camera in a rotated frame.
    a = om.sphere(640)
    model = dataclasses.replace(a.model, cx=a.model.cx + 80)
    comparison = om.compare(a, om.Camera(model, a.size))
    assert comparison.verdict == "equal"
    assert comparison.fixed.rms(comparison.common) > 50
    angle = np.degrees(np.arccos((np.trace(comparison.rotation) - 1) / 2))
    assert angle == pytest.approx(45.0, abs=1e-3)


def test_a_camera_without_the_mirror_of_the_other_is_compared_after_left_and_right_are_exchanged():
    flip = np.array([-1.0, *[1.0] * 7])
    mirrored = dataclasses.replace(
        FISHEYE, model=LENS.with_params(flip * LENS.params), covariance=FISHEYE.covariance * np.outer(flip, flip)
    )
    assert CameraComparison.of(FISHEYE, mirrored, columns=24).verdict == "equal"
    other = drawn(np.random.default_rng(3))
    alone = CameraComparison.of(FISHEYE, other, columns=24)
    found = CameraComparison.of(mirrored, other, columns=24)
    assert found.is_mirrored
    assert not alone.is_mirrored
    assert "after left and right are exchanged" in found.sentence
    assert found.rms == pytest.approx(alone.rms, rel=1e-6)
    assert found.test.p_value == pytest.approx(alone.test.p_value, rel=1e-6)


def test_the_figures_of_a_difference_are_those_that_decide():
    """The difference is below the expected rms, but one component of it exceeds its uncertainty."""
    focal, others = np.array([1.0, 1.0, *[0.0] * 6]), np.diag([0.01, 0.01, 0.01, 0.01, 1e-3, 1e-3, 1e-3, 1e-3])
    camera = dataclasses.replace(FISHEYE, covariance=np.outer(focal, focal) + others**2)
    shifted = dataclasses.replace(camera, model=dataclasses.replace(LENS, k1=LENS.k1 + 8e-3))
    found = CameraComparison.of(camera, shifted, columns=24)
    assert found.verdict == "different"
    assert found.rms < found.test.expected_rms
    assert found.test.is_of_component
    assert found.test.component_rms > 2 * found.test.component_expected_rms
    assert f"{found.test.component_rms:.2g} px rms of one component of the uncertainty" in found.sentence


def test_a_limit_of_the_angle_does_not_change_the_calibrated_field_of_view():
    limited = om.compare(FISHEYE, FISHEYE, om.CompareOptions(max_theta=30))
    assert np.degrees(limited.common_theta_max) <= 30
    assert limited.a.theta_max == 1.2


def test_cameras_of_images_of_other_sizes_are_scaled():
    rng = np.random.default_rng(3)
    other = drawn(rng)
    same, scaled = (om.compare(FISHEYE, b) for b in (other, other.scaled(2.5)))
    assert scaled.rms == pytest.approx(same.rms, rel=1e-6)
    assert scaled.test.p_value == pytest.approx(same.test.p_value, rel=1e-3)
    assert om.compare(FISHEYE, FISHEYE.scaled(2.0)).verdict == "equal"


def test_the_common_field_of_view_is_that_of_both():
    narrow = dataclasses.replace(FISHEYE, theta_max=0.6)
    for pair in ((FISHEYE, narrow), (narrow, FISHEYE)):
        assert np.degrees(om.compare(*pair).common_theta_max) == pytest.approx(np.degrees(0.6), abs=1.0)
    assert np.degrees(om.compare(FISHEYE, FISHEYE, om.CompareOptions(max_theta=20)).common_theta_max) < 20


def test_one_uncertainty_is_enough_for_a_test():
    other = dataclasses.replace(drawn(np.random.default_rng(5)), covariance=None)
    comparison = om.compare(FISHEYE, other)
    assert comparison.verdict == "same"
    assert "within the uncertainty of a" in comparison.sentence
    assert comparison.uncertainties[1] is None


@pytest.mark.parametrize(
    ("b", "message"),
    [
        (om.perspective((640, 360), 60), "a different aspect ratio"),
        (dataclasses.replace(FISHEYE, theta_min=1.3, theta_max=1.4), "no calibrated field of view in common"),
    ],
)
def test_cameras_that_cannot_be_compared_are_refused(b, message):
    with pytest.raises(ValueError, match=message):
        om.compare(FISHEYE, b)


def test_the_command_prints_and_draws_the_difference(tmp_path, capsys):
    om.save(FISHEYE, tmp_path / "a.json")
    om.save(drawn(np.random.default_rng(4)), tmp_path / "b.json")
    for arguments in ((), ("--json",)):
        with pytest.raises(SystemExit) as caught:
            cli.main(
                [
                    "compare",
                    str(tmp_path / "a.json"),
                    str(tmp_path / "b.json"),
                    "-o",
                    str(tmp_path / "d.png"),
                    *arguments,
                ]
            )
        assert not caught.value.code
        out = capsys.readouterr().out
        if not arguments:
            assert "verdict     the cameras are the same within their uncertainties: " in out
            continue
        figures = json.loads(out)
        assert figures["verdict"] == "same"
        assert 0.01 < figures["p_value"] <= 1
        assert figures["difference"]["rms_px"] < figures["difference_without_rotation"]["rms_px"]
        assert [camera["name"] for camera in figures["cameras"]] == ["a.json", "b.json"]
    drawing = read_image(tmp_path / "d.png")
    assert drawing.shape[1] == 1460
    assert drawing.std() > 30


def test_a_distance_is_refused_for_central_cameras():
    camera = om.Camera(om.fisheye(256, 180.0).model, (256, 256))
    with pytest.raises(ValueError, match="--distance is for non-central cameras, and both are central"):
        om.compare(camera, camera, om.CompareOptions(distance="2m"))
