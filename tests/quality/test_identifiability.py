"""Parameters that the images do not determine, and the standard deviation of the focal length."""

import numpy as np
import pytest

from calibrating import SIZE, calibrate, observe
from lenses import lens, observe_boards
from omnisight.camera import Camera
from omnisight.models import model_class, model_names
from omnisight.quality.identifiability import focal_relative_sigma, unidentifiable_parameters


@pytest.mark.parametrize("name", model_names())
def test_zero_covariance_gives_zero_focal_sigma_and_no_unidentifiable_parameter(name):
    model = model_class(name).example()
    covariance = np.zeros((len(model.params), len(model.params)))
    assert focal_relative_sigma(Camera(model, SIZE)) is None
    # None for a mirror, which does not show its axis.
    assert focal_relative_sigma(Camera(model, SIZE, covariance=covariance)) in (0.0, None)
    assert unidentifiable_parameters(Camera(model, SIZE, covariance=covariance)) == []


def test_sigma_of_a_tenth_of_the_focal_length_is_a_tenth():
    model = model_class("kannala_brandt").example()
    focal = model.params[0]
    names = list(model.param_names)
    covariance = np.zeros((len(names), len(names)))
    covariance[names.index("fx"), names.index("fx")] = (focal / 10) ** 2
    covariance[names.index("k4"), names.index("k4")] = 0.5**2
    camera = Camera(model, SIZE, covariance=covariance)
    assert focal_relative_sigma(camera) == pytest.approx(0.1, rel=1e-6)
    assert unidentifiable_parameters(camera) == [f"fx (±{focal / 10:.2g} px)", "k4 (±0.5)"]


def test_one_image_does_not_determine_the_distortion_and_eight_do():
    views = observe_boards(lens(180), 180, np.random.default_rng(0))
    one = calibrate(observe(views[:1]), model="kannala_brandt", force=True, flat=True)
    (reason,) = [reason for reason in one.reasons if "not determine all parameters" in reason]
    assert "k4 (±" in reason
    assert "--model" not in " ".join(one.reasons)
    eight = calibrate(observe(views), model="kannala_brandt", flat=True)
    assert focal_relative_sigma(eight.camera) < 0.5 * focal_relative_sigma(one.camera)
    assert not any("determine all parameters" in reason for reason in eight.reasons)
