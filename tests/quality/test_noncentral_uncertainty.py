"""Uncertainty of non-central cameras, and the central model they are compared with."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from calibrating import calibrate
from noncentral import SIZE, calibrate_noncentral, observe_boards, off_focus, pupil_shift_fisheye, sphere
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.prescription import resect_prescription
from omnisight.calibration.rotation_alignment import rotation_aligned_difference
from omnisight.geometry.sphere import cap, polar
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.central_limit import CentralLimit
from omnisight.optics.models.axial import Axial
from omnisight.optim.tolerances import FINAL_TOLERANCE
from omnisight.quality.central_frame import in_central_frame
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.uncertainty import Uncertainty

LENS = KannalaBrandt(fx=380, fy=381, cx=641, cy=510, k1=-0.02, k2=0.004, k3=-0.001, k4=0.0)
AXIAL = Axial(LENS, (0.008, 0.001))
REACH = 1.5
NOISE = 0.3  # px


def bearings_between(first, last):
    """Return bearings between two angles from the axis (radians), at all azimuths."""
    return polar(np.linspace(first, last, 40), np.linspace(0.1, 6.2, 40))


def test_central_limit_of_an_axial_camera_is_its_lens():
    bearings = bearings_between(0.0, REACH)
    pixels, valid, d_point, d_params = CentralLimit(AXIAL).project_with_jacobians(bearings)
    truth = LENS.project_with_jacobians(bearings)
    assert valid.all()
    np.testing.assert_allclose(pixels, truth[0], atol=1e-6)
    np.testing.assert_allclose(d_point, truth[2], atol=1e-5)
    np.testing.assert_allclose(d_params[..., :-2], truth[3], atol=1e-5)
    np.testing.assert_allclose(d_params[..., -2:], 0.0, atol=1e-5)
    assert CentralLimit(AXIAL).param_names == AXIAL.param_names


@pytest.mark.parametrize("make", [off_focus, sphere])
def test_central_limit_of_a_mirror_follows_its_rays(make):
    far, bearings = CentralLimit(make().system), bearings_between(0.3, 1.8)
    pixels, valid, d_point, _ = far.project_with_jacobians(bearings)
    assert valid.all()
    unprojected, valid = far.unproject(pixels)
    assert valid.all()
    np.testing.assert_allclose(unprojected, bearings, atol=1e-8)
    step = 1e-5
    moved = [(far.project(bearings + e)[0] - far.project(bearings - e)[0]) / (2 * step) for e in step * np.eye(3)]
    np.testing.assert_allclose(d_point, np.stack(moved, -1), atol=1e-4)
    # The angle grows with the radius in the image, as for a lens.
    middle = make().system.lens.project([0.0, 0.0, 1.0])[0]
    assert (np.diff(np.linalg.norm(pixels - middle, axis=1)) > 0).all()


def test_calibrated_cone_of_a_mirror_is_about_its_reversed_axis():
    camera = om.RayCamera(off_focus().system, SIZE, theta_max=2.9, theta_min=1.2)
    far = camera.central_limit
    assert (far.theta_min, far.theta_max) == (pytest.approx(np.pi - 2.9), pytest.approx(np.pi - 1.2))
    lens = om.RayCamera(AXIAL, SIZE, theta_max=REACH).central_limit
    assert (lens.theta_min, lens.theta_max) == (0.0, REACH)


def test_central_limit_has_its_origin_at_the_point_nearest_to_all_rays():
    system = off_focus().system
    views, _ = observe_boards(off_focus(), 6, noise=0.0, distance=(0.3, 0.8))
    estimated = in_central_frame(resect_prescription(system, views), system, views.pixels).points(views)[0]
    bearings, _ = CentralLimit(system).unproject(views.pixels)
    cosine = (estimated * bearings).sum(1) / np.linalg.norm(estimated, axis=1)
    assert np.degrees(np.arccos(cosine.min())) < 2.0


@pytest.fixture(scope="module")
def repeated_fits():
    """Return 80 axial fits to the same boards with different noise, and their observations."""
    views, _ = observe_boards(om.RayCamera(AXIAL, SIZE), 14, noise=0.0)
    central = calibrate(views, model="kannala_brandt", flat=True)
    candidates = calibrate_noncentral(central).candidates
    start = next(c for c in candidates if c.name == "axial kannala_brandt, 2")
    assert start.rms < 1e-6
    rng, fits = np.random.default_rng(5), []
    free = start.free_parameters
    for _ in range(80):
        noisy = dataclasses.replace(views, pixels=views.pixels + NOISE * rng.standard_normal(views.pixels.shape))
        fitted = Candidate.fit("axial", start.state, noisy, free, loss="huber", tolerance=FINAL_TOLERANCE)
        fits.append((fitted, noisy))
    return fits


def test_projection_uncertainty_at_infinity_matches_repeated_fits(repeated_fits):
    bearings = cap(REACH, 12)
    pixels, _ = LENS.project(bearings)
    inside = ((pixels > 0) & (pixels < SIZE)).all(1)
    bearings, pixels = bearings[inside], pixels[inside]
    errors = [rotation_aligned_difference(CentralLimit(c.state.model), bearings, pixels) for c, _ in repeated_fits]
    observed = np.sqrt((np.array(errors) ** 2).sum(-1).mean())
    predicted = [Uncertainty.of(ray_camera(*of).central_limit).projection(bearings) for of in repeated_fits[:10]]
    stated = np.sqrt(np.trace(np.array(predicted), axis1=2, axis2=3).mean())
    assert stated / observed == pytest.approx(1.0, abs=0.15)


def test_uncertainty_of_the_pupil_shift_matches_repeated_fits(repeated_fits):
    cone = 0.0, REACH
    lengths = [c.state.model.pupil_shift(*cone) for c, _ in repeated_fits]
    cameras = [ray_camera(*of) for of in repeated_fits[:10]]
    stated = [PupilShift.between(camera.model, camera.covariance, cone) for camera in cameras]
    assert stated[0].length == pytest.approx(lengths[0])
    assert np.mean([shift.length_sigma for shift in stated]) / np.std(lengths, ddof=1) == pytest.approx(1.0, abs=0.2)
    # The uncertainty grows with the distance from the reference angle.
    assert stated[0].sigma[0] == 0.0
    assert (np.diff(stated[0].sigma) > 0).all()


def ray_camera(candidate, views):
    covariance = camera_covariance(candidate, views)
    return om.RayCamera(candidate.state.model, SIZE, unit="m", theta_max=REACH, covariance=covariance)


def test_pupil_shift_between_two_angles_does_not_depend_on_the_reference():
    covariance = np.diag([*np.zeros(8), 4e-8, 1e-8])
    theta = np.linspace(0.6, 1.4, 9)
    shifts = [PupilShift.of(AXIAL, covariance, theta, first) for first in (0.0, 0.6, 1.0)]
    for shift in shifts:
        assert shift.length == pytest.approx(np.ptp(AXIAL.pupil_z(theta)))
        assert shift.length_sigma == pytest.approx(shifts[0].length_sigma)
    np.testing.assert_allclose(shifts[1].position, AXIAL.pupil_z(theta) - AXIAL.pupil_z(0.6), atol=1e-15)


def test_axial_camera_is_compared_with_the_same_lens_without_pupil_shift():
    """If that lens is better than the selected central model."""
    views, _ = observe_boards(om.Camera(LENS, SIZE), 12, noise=0.2, distance=(0.15, 0.6))
    central = calibrate(views, model="equidistant", flat=True)
    calibration = calibrate_noncentral(central, spline=central.quality.spline_baseline.candidate)
    assert calibration.held_out_rms < 0.8 * central.held_out_rms
    assert calibration.central.name != "equidistant"
    assert calibration.central.held_out_rms < 0.8 * central.held_out_rms
    assert not calibration.quality.noncentrality.is_noncentral
    assert calibration.quality.noncentrality.central_rms == pytest.approx(calibration.central.held_out_rms)
    assert calibration.camera.calibration["central"] == calibration.central.name


def test_noncentral_calibration_reports_what_a_central_one_does():
    views, _ = observe_boards(pupil_shift_fisheye(), 9, noise=0.1)
    central = calibrate(views, model="kannala_brandt", flat=True)
    calibration = calibrate_noncentral(central)
    assert calibration.verdict is calibration.quality.verdict
    assert calibration.mean < calibration.rms < central.rms
    assert np.sqrt((calibration.residual_lengths**2).mean()) == pytest.approx(calibration.rms)
    assert calibration.best is calibration.candidates[0]
    assert calibration.quality.noncentrality.axial_rms == calibration.held_out_rms
    assert calibration.quality.noncentrality.shift == pytest.approx(calibration.camera.calibration["pupil_shift"])
    assert calibration.quality.noncentrality.unit == "m"
    assert calibration.camera.calibration["uncertainty_px"] == calibration.quality.uncertainty.worst()[0]
    assert calibration.quality.coverage.corners[1:].sum() + calibration.quality.coverage.corners[0, 0] == len(
        views.pixels
    )
