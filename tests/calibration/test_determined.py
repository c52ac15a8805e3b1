"""What the images leave open is named, with how open it is."""

import numpy as np
import pytest

from lenses import SIZE, lens, observe_boards
from omnisight.camera import Camera
from omnisight.models import model_class, model_names
from omnisight.pipeline.central import calibrate_camera
from omnisight.quality.identifiability import focal_relative_sigma, unidentifiable_parameters
from omnisight.targets.observations import Observations


@pytest.mark.parametrize("name", model_names())
def test_the_focal_length_spreads_as_its_parameters_have_it(name):
    model = model_class(name).example()
    covariance = np.zeros((len(model.params), len(model.params)))
    assert focal_relative_sigma(Camera(model, SIZE)) is None
    assert focal_relative_sigma(Camera(model, SIZE, covariance=covariance)) in (
        0.0,
        None,
    )  # None of a mirror without an axis
    assert unidentifiable_parameters(Camera(model, SIZE, covariance=covariance)) == []


def test_a_tenth_of_the_focal_length_is_a_tenth():
    model = model_class("kannala_brandt").example()
    focal = model.params[0]
    names = list(model.param_names)
    covariance = np.zeros((len(names), len(names)))
    covariance[names.index("fx"), names.index("fx")] = (focal / 10) ** 2
    covariance[names.index("k4"), names.index("k4")] = 0.5**2
    camera = Camera(model, SIZE, covariance=covariance)
    assert focal_relative_sigma(camera) == pytest.approx(0.1, rel=1e-6)
    assert unidentifiable_parameters(camera) == [f"fx (+-{focal / 10:.2g} px)", "k4 (+-0.5)"]


def test_one_picture_leaves_the_distortion_open_and_eight_are_surer():
    views = observe_boards(lens(180), 180, np.random.default_rng(0))
    one = calibrate_camera(Observations.of(views[:1]), SIZE, model="kannala_brandt", force=True, flat=True)
    (reason,) = [reason for reason in one.verdict.reasons if "parameters open" in reason]
    assert "k4 (+-" in reason
    assert "--model equidistant --square-pixels" in reason
    all_ = calibrate_camera(Observations.of(views), SIZE, model="kannala_brandt", flat=True)
    assert focal_relative_sigma(all_.camera) < 0.5 * focal_relative_sigma(one.camera)
    assert not any("open" in reason for reason in all_.verdict.reasons)
