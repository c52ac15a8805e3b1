"""Covariance of board poses: repeated calibrations confirm it, for their own images and for others."""

import numpy as np
import pytest

from calibrating import SIZE, observe
from lenses import NOISE, lens, observe_boards
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.evaluation import Evaluation, evaluate_camera
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.pose_covariance import pose_covariances
from omnisight.calibration.resection import resect
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3

CALIBRATIONS = 40


def pose_errors(state, true):
    """Return the steps (V, 6) from the true poses to the estimated ones."""
    turns = so3.log(state.rotations @ np.swapaxes(true.rotations, 1, 2))
    return np.concatenate([turns, state.translations - true.translations], 1)


def normalized_square(errors, covariances):
    """Return the mean squared error of a coordinate relative to its covariance; 1 if that is right."""
    return float(np.einsum("ki,kij,kj->k", errors, np.linalg.inv(covariances), errors).mean() / errors.shape[1])


@pytest.mark.parametrize(("fov", "warp"), [(180, False), (280, True)])
def test_errors_of_poses_match_their_covariance(fov, warp):
    truth = lens(fov)
    boards = [observe_boards(truth, fov, np.random.default_rng(k), count=n, noise=0.0) for k, n in ((0, 12), (1, 5))]
    true, true_others = (resect(truth, observe(views)) for views in boards)
    own, others, from_noise = [], [], []
    for seed in range(CALIBRATIONS):
        rng = np.random.default_rng(seed)
        views, new = (observe([(x, p + rng.normal(0, NOISE, p.shape)) for x, p in exact]) for exact in boards)
        start = resect(truth, views)
        fitted = Candidate.fit(truth.name, start, views, FreeParameters.of(start.model, warp=warp), loss="huber")
        covariance = camera_covariance(fitted, views)
        stated = pose_covariances(fitted, views, covariance)
        own.append(normalized_square(pose_errors(fitted.state, true), stated))
        evaluation = evaluate_camera(Camera(fitted.state.model, SIZE, covariance=covariance), new, flat=not warp)
        errors = pose_errors(evaluation.state, true_others)
        others.append(normalized_square(errors, evaluation.pose_covariances))
        exact = Evaluation(Camera(fitted.state.model, SIZE), evaluation.state, new)
        from_noise.append(normalized_square(errors, exact.pose_covariances))
    assert np.mean(own) == pytest.approx(1.0, abs=0.15)
    assert np.mean(others) == pytest.approx(1.0, abs=0.15)
    assert np.mean(from_noise) > 5
