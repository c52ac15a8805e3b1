"""Model averaging: probabilities of the models, and uncertainty under weak data."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.model_choice import Trial, run

from calibrating import observe
from lenses import lens, observe_boards
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.model_averaging import averaged_covariance, expected_errors, with_probabilities
from omnisight.calibration.multistart import model_starts
from omnisight.calibration.resection import resect
from omnisight.quality.evidence import Level


def candidates(noise=0.1, names=("equisolid", "kannala_brandt")):
    """Return cross-validated candidates for images of an equisolid lens, with what they were fitted to."""
    observations = observe(observe_boards(lens(180), 180, np.random.default_rng(3), noise=noise))
    inliers, initial = np.ones(len(observations.pixels), bool), estimate_initial_camera(observations)
    fitted = []
    for name in names:
        ((label, start),) = model_starts(name, initial, observations)
        candidate = Candidate.fit(label, start, observations, FreeParameters.of(start.model), loss="huber")
        fitted.append(candidate.cross_validated(observations, inliers, loss="huber"))
    return fitted, observations, inliers


def test_probabilities_follow_the_held_out_errors():
    (one, other), observations, inliers = candidates()
    worse = replace(other, held_out_lengths=2 * one.held_out_lengths, held_out_rms=2 * one.held_out_rms)
    twin = replace(one, name="twin")
    found = with_probabilities([one, twin, worse], observations, inliers)
    assert [c.probability for c in found] == pytest.approx([0.5, 0.5, 0.0], abs=1e-9)


def test_models_that_agree_add_only_the_small_number_of_views_to_the_covariance():
    (one, _), observations, inliers = candidates()
    views = len(observations)
    twins = with_probabilities([one, replace(one, name="twin")], observations, inliers)
    averaged = averaged_covariance(twins[0], twins, observations)
    own = camera_covariance(one, observations)
    np.testing.assert_allclose(averaged, own * (1 + 2 / (views - 1)), rtol=1e-6, atol=1e-18)
    np.testing.assert_array_equal(averaged_covariance(twins[0], twins[:1], observations), own)
    errors = expected_errors(twins, observations)
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)


def test_disagreement_is_added_to_the_covariance():
    (one, _), observations, inliers = candidates()
    focal = one.state.model.fx * 1.001
    other = resect(one.state.model.with_values({"fx": focal, "fy": focal}), observations)
    pair = with_probabilities([one, replace(one, name="larger", state=other)], observations, inliers)
    factor = 1 + 2 / (len(observations) - 1)
    added = averaged_covariance(pair[0], pair, observations) / factor - camera_covariance(one, observations)
    fx = one.state.model.param_names.index("fx")
    # Half of the mixture has a focal length larger by 0.1 %.
    assert added[fx, fx] == pytest.approx(0.5 * (0.001 * one.state.model.fx) ** 2, rel=0.2)


# Before models were averaged, each of these was 2 to 7 times as far off as stated.
WEAK = ("equisolid/8/1", "double_sphere/6/3", "equisolid/6/1", "double_sphere/8/1")


@pytest.mark.slow
@pytest.mark.parametrize("text", WEAK)
def test_stated_uncertainty_includes_the_doubt_between_models(text):
    camera, tilt, seed = text.split("/")
    result = run(Trial(camera, float(tilt), int(seed)))
    assert result.cone.rms <= 2 * result.cone.stated
    assert result.level > Level.GOOD or result.cone.rms <= 1
    assert result.level > Level.USABLE or result.cone.rms <= 2
