"""Weights of residuals from the covariances of the corners."""

import numpy as np
import pytest

from calibrating import observe
from lenses import bearing_error, lens, observe_boards
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.initial_camera import estimate_initial_camera
from omnisight.calibration.resection import resect
from omnisight.calibration.residual_weights import ResidualWeights


def isotropic(sigma):
    """Return the covariance of corners with the standard deviations (N,)."""
    return np.asarray(sigma)[..., None, None] ** 2 * np.eye(2)


def observe_fisheye(model, seed=0, count=6, noise=0.2):
    """Return noisy views (points, pixels) of boards through a fisheye of 180 degrees."""
    return observe_boards(model, 180, np.random.default_rng(seed), count=count, noise=noise)


def test_residuals_have_equal_weights_without_covariances():
    views = observe(observe_fisheye(lens(180)))
    assert (ResidualWeights.estimate(estimate_initial_camera(views), views).whitening == np.eye(2)).all()


def test_whitened_residuals_have_equal_variances():
    rng = np.random.default_rng(2)
    uncertain = np.zeros((6, 54))
    uncertain[:, ::3] = 1.0
    views = observe_fisheye(lens(180), noise=0.1)
    noise = rng.normal(size=(6, 54, 2)) * uncertain[..., None]
    views = observe([(p, uv + n, isotropic(s)) for (p, uv), n, s in zip(views, noise, uncertain, strict=True)])
    state, uncertain_rows = estimate_initial_camera(views), uncertain.ravel() > 0
    whitening = ResidualWeights.estimate(state, views).whitening
    lengths = state.lengths(views)
    assert np.median(lengths[uncertain_rows]) > 6 * np.median(lengths[~uncertain_rows])
    lengths = state.lengths(views, whitening)
    assert np.median(lengths[uncertain_rows]) == pytest.approx(np.median(lengths[~uncertain_rows]), rel=0.25)
    # The variance common to all corners is estimated from the residuals: 0.1 px besides the stated 0 and 1 px.
    weight = np.linalg.norm(whitening, axis=(1, 2))
    assert weight[~uncertain_rows].min() / weight[uncertain_rows].max() == pytest.approx(
        np.hypot(1, 0.1) / 0.1, rel=0.25
    )
    np.testing.assert_allclose(whitening[uncertain_rows], whitening[uncertain_rows][:1].repeat(uncertain_rows.sum(), 0))


def test_uncertainty_in_one_direction_does_not_lower_the_weight_of_the_other():
    views = observe_fisheye(lens(180), noise=0.1)
    rotation = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    one_axis = rotation @ np.diag([1.0, 0.0]) @ rotation.T
    covariance = np.tile(one_axis, (54, 1, 1)) * (np.arange(54) % 5 == 0)[:, None, None]
    views = observe([(*view, covariance) for view in views])
    whitening = ResidualWeights.estimate(estimate_initial_camera(views), views).whitening
    along, across = (np.linalg.norm(whitening @ rotation[:, k], axis=1) for k in (0, 1))
    uncertain_rows = np.arange(len(whitening)) % 54 % 5 == 0
    assert (along[uncertain_rows] < 0.2 * across[uncertain_rows]).all()
    np.testing.assert_allclose(along[~uncertain_rows], across[~uncertain_rows])
    np.testing.assert_allclose(across[uncertain_rows], across[~uncertain_rows][0])


def test_correct_covariances_reduce_the_error_of_the_camera():
    """A quarter of the corners is ten times as noisy as the others."""
    truth = lens(180)
    with_covariance, without = [], []
    for seed in range(6):
        views, rng = [], np.random.default_rng(100 + seed)
        for points, pixels in observe_fisheye(truth, seed, noise=0.0):
            sigmas = np.where(rng.random(len(points)) < 0.25, 1.0, 0.1)
            views.append((points, pixels + rng.normal(size=pixels.shape) * sigmas[:, None], isotropic(sigmas)))
        for errors, some in ((with_covariance, views), (without, [view[:2] for view in views])):
            observations = observe(some)
            model = refine(resect(truth, observations), observations).state.model
            errors.append(bearing_error(model, truth, np.radians(85)))
    assert np.mean(with_covariance) < 0.8 * np.mean(without)
