"""Evaluation of cameras on images they were not calibrated on."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from calibrating import SIZE, calibrate, observe
from lenses import NOISE, NOISE_RMS, lens, observe_boards
from omnisight.calibration.evaluation import ResidualStatistics, evaluate_camera
from omnisight.camera import Camera
from omnisight.corners import read_corners
from omnisight.geometry import rotation as so3
from omnisight.models import model_class
from omnisight.optics.models.axial import Axial
from omnisight.ray_camera import RayCamera
from omnisight.targets.observations import Observations

COUNT = 6


def observe_lens(fov, seed=0, **options):
    """Return a lens and observations of boards."""
    truth = lens(fov)
    return truth, observe(observe_boards(truth, fov, np.random.default_rng(seed), COUNT, **options))


@pytest.mark.parametrize("fov", [100, 180, 280])
def test_residuals_of_the_true_camera_are_the_noise(fov):
    truth, views = observe_lens(fov)
    evaluation = evaluate_camera(Camera(truth, SIZE), views)
    corners = 54 * COUNT
    # The estimated poses reduce the residuals.
    degrees_of_freedom = 1 - 6 * COUNT / (2 * corners)
    assert evaluation.statistics().rms == pytest.approx(NOISE_RMS * np.sqrt(degrees_of_freedom), rel=0.1)
    assert evaluation.statistics().corners == corners
    assert evaluation.camera.model is truth
    np.testing.assert_array_equal(evaluation.state.model.params, truth.params)


def test_poses_are_those_of_babelcalib():
    """Its residuals are w dx, w = sqrt(T/|dx|) past T, and each pose minimises their squares: nearly Huber's loss."""
    truth, views = observe_lens(180)
    rng = np.random.default_rng(1)
    outliers = rng.random(len(views.pixels)) < 0.1
    views.pixels[outliers] += rng.uniform(-8, 8, (outliers.sum(), 2))
    camera = Camera(truth.with_params(truth.params * (1.01, 1.0, 1.0, 1.0)), SIZE)
    evaluation = evaluate_camera(camera, views)
    threshold = 1.5

    def weighted(pose, points, pixels):
        residuals = camera.project(points @ so3.exp(pose[:3]).T + pose[3:])[0] - pixels
        length = np.linalg.norm(residuals, axis=1, keepdims=True)
        return np.where(length > threshold, np.sqrt(threshold / np.maximum(length, 1e-9)), 1.0) * residuals

    squares, lengths = [], []
    for k, rows in enumerate(views.groups):
        pair = views.points[rows], views.pixels[rows]
        start = np.concatenate([so3.log(evaluation.state.rotations[k]), evaluation.state.translations[k]])
        nudged = start + rng.normal(0, 1e-3, 6)
        best = least_squares(lambda p, pair=pair: weighted(p, *pair).ravel(), nudged, xtol=1e-14, ftol=1e-14)
        squares.append((best.fun**2).reshape(-1, 2).sum(1))
        lengths.append(
            np.linalg.norm(camera.project(pair[0] @ so3.exp(best.x[:3]).T + best.x[3:])[0] - pair[1], axis=1)
        )
    statistics = evaluation.statistics()
    assert statistics.wrms == pytest.approx(np.sqrt(np.concatenate(squares).mean()), rel=2e-3)
    assert statistics.rms == pytest.approx(np.sqrt((np.concatenate(lengths) ** 2).mean()), rel=1e-2)
    assert statistics.wrms < statistics.rms


def test_statistics_in_closed_form():
    statistics = ResidualStatistics.of(np.array([0.0, 1.0, 1.5, 6.0]))
    assert statistics.corners == 4
    assert statistics.rms == pytest.approx(np.sqrt((1 + 2.25 + 36) / 4))
    assert statistics.wrms == pytest.approx(np.sqrt((1 + 2.25 + 1.5 * 6) / 4))
    assert (statistics.mean, statistics.median, statistics.worst) == (2.125, 1.25, 6.0)
    assert ResidualStatistics.of(np.zeros(0)).as_dict()["rms"] is None


def test_wrong_camera_has_a_much_larger_rms():
    truth, views = observe_lens(180)
    worse = Camera(truth.with_params(truth.params * (1.1, 1.1, 1.0, 1.0)), SIZE)
    good, bad = (evaluate_camera(camera, views).statistics() for camera in (Camera(truth, SIZE), worse))
    assert bad.rms > 3 * good.rms


def test_corners_beyond_the_calibrated_cone_have_their_own_statistics():
    truth, views = observe_lens(180)
    evaluation = evaluate_camera(Camera(truth, SIZE, theta_max=np.radians(60)), views)
    inside, beyond = evaluation.statistics(evaluation.calibrated), evaluation.statistics(~evaluation.calibrated)
    assert inside.corners + beyond.corners == evaluation.statistics().corners
    assert beyond.corners > 20
    assert np.degrees(evaluation.theta[~evaluation.calibrated]).min() > 60
    rings = evaluation.rings()
    assert sum(ring.statistics.corners for ring in rings) == evaluation.statistics().corners
    squares = sum(ring.statistics.corners * ring.statistics.rms**2 for ring in rings)
    assert np.sqrt(squares / evaluation.statistics().corners) == pytest.approx(evaluation.statistics().rms)
    assert len(rings) > 5
    assert all(np.degrees(ring.stop - ring.start) == pytest.approx(10) for ring in rings)


def test_corners_outside_the_domain_are_excluded_from_the_statistics():
    _, views = observe_lens(180)
    # The domain of an orthographic lens ends at 90 degrees.
    narrow = model_class("orthographic").from_dict({"fx": 300.0, "fy": 300.0, "cx": 481.3, "cy": 476.2})
    evaluation = evaluate_camera(Camera(narrow, SIZE), views)
    statistics = evaluation.statistics()
    assert np.isfinite(statistics.rms)
    assert statistics.corners == evaluation.in_domain.sum()
    assert evaluation.outliers[~evaluation.in_domain].all()


def test_board_warp_is_estimated():
    truth, views = observe_lens(140, noise=0.02)
    bent = views.points + np.outer(views.warp_basis @ [0.03, -0.02], [0, 0, 1.0])
    curved = []
    pose = evaluate_camera(Camera(truth, SIZE), views).state
    for k, rows in enumerate(views.groups):
        pixels = truth.project(bent[rows] @ pose.rotations[k].T + pose.translations[k])[0]
        curved.append((views.points[rows], pixels))
    curved = observe(curved)
    camera = Camera(truth, SIZE)
    flat, free = (evaluate_camera(camera, curved, flat=flat) for flat in (True, False))
    np.testing.assert_allclose(free.state.warp, [0.03, -0.02], atol=2e-4)
    assert free.statistics().rms < 0.01 < flat.statistics().rms


def test_noncentral_camera_without_pupil_shift_equals_its_lens():
    truth, views = observe_lens(180)
    axial = RayCamera(Axial(truth, (0.0, 0.0)), SIZE, unit="squares")
    central, rays = (evaluate_camera(camera, views).statistics() for camera in (Camera(truth, SIZE), axial))
    assert rays.rms == pytest.approx(central.rms, abs=1e-4)


def test_missing_corners_and_invalid_threshold_are_errors():
    truth, views = observe_lens(180)
    with pytest.raises(ValueError, match="there are no corners to evaluate the camera on"):
        evaluate_camera(Camera(truth, SIZE), observe([]))
    with pytest.raises(ValueError, match="threshold must be a positive length in px, got 0"):
        evaluate_camera(Camera(truth, SIZE), views, threshold=0)


def test_boards_up_to_140_degrees_off_axis_are_resected():
    truth, views = observe_lens(280, seed=9)
    assert evaluate_camera(Camera(truth, SIZE), views).statistics().rms < 2 * NOISE


def test_camera_of_half_of_the_babelcalib_images_fits_the_other_half(data):
    views = Observations.from_detections(read_corners([data("babelcalib_ov_plane") / "train.mat"]))
    even, odd = (views.subset(range(k, 18, 2)) for k in (0, 1))
    camera = calibrate(even, model="kannala_brandt", flat=True).camera
    held_out = evaluate_camera(camera, odd).statistics()
    # BabelCalib states 0.4815 px over all images, and 0.475 px on its test split.
    assert held_out.rms < 0.50
    assert held_out.wrms < held_out.rms
