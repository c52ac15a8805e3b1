"""How sure a camera of rays is of itself, and what it is compared with."""

import dataclasses

import numpy as np
import pytest
from omnisight.calibration.axial import fit

import omnisight as om
from calibrating import calibrate
from noncentral import SIZE, observe_boards, off_focus, pupil_shift_fisheye, sphere
from omnisight.calibration.covariance import camera_covariance
from omnisight.calibration.prescription import placed
from omnisight.geometry.sphere import cap, polar
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.models.axial import Axial
from omnisight.quality.central_limit import CentralLimit, central_limit, in_central_frame
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.split_half import rotation_aligned_difference
from omnisight.quality.uncertainty import Uncertainty

LENS = KannalaBrandt(fx=380, fy=381, cx=641, cy=510, k1=-0.02, k2=0.004, k3=-0.001, k4=0.0)
MOVING = Axial(LENS, (0.008, 0.001))
REACH = 1.5
NOISE = 0.3  # px


def around(first, last):
    return polar(np.linspace(first, last, 40), np.linspace(0.1, 6.2, 40))


def test_what_is_far_is_seen_by_the_lens_of_an_axial_camera():
    bearings = around(0.0, REACH)
    pixels, valid, d_point, d_params = CentralLimit(MOVING).project_with_jacobians(bearings)
    truth = LENS.project_with_jacobians(bearings)
    assert valid.all()
    np.testing.assert_allclose(pixels, truth[0], atol=1e-6)
    np.testing.assert_allclose(d_point, truth[2], atol=1e-5)
    np.testing.assert_allclose(d_params[..., :-2], truth[3], atol=1e-5)
    np.testing.assert_allclose(d_params[..., -2:], 0.0, atol=1e-5)
    assert CentralLimit(MOVING).param_names == MOVING.param_names


@pytest.mark.parametrize("make", [off_focus, sphere])
def test_what_is_far_is_seen_over_a_mirror_as_its_rays_go(make):
    far, bearings = CentralLimit(make().system), around(0.3, 1.8)
    pixels, valid, d_point, _ = far.project_with_jacobians(bearings)
    assert valid.all()
    back, seen = far.unproject(pixels)
    assert seen.all()
    np.testing.assert_allclose(back, bearings, atol=1e-8)
    step = 1e-5
    moved = [(far.project(bearings + e)[0] - far.project(bearings - e)[0]) / (2 * step) for e in step * np.eye(3)]
    np.testing.assert_allclose(d_point, np.stack(moved, -1), atol=1e-4)
    # Angles grow outwards in the image, as those of a lens do.
    middle = make().system.lens.project([0.0, 0.0, 1.0])[0]
    assert (np.diff(np.linalg.norm(pixels - middle, axis=1)) > 0).all()


def test_the_cone_behind_a_mirror_counts_from_its_axis():
    camera = om.RayCamera(off_focus().system, SIZE, theta_max=2.9, theta_min=1.2)
    far = central_limit(camera)
    assert (far.theta_min, far.theta_max) == (pytest.approx(np.pi - 2.9), pytest.approx(np.pi - 1.2))
    lens = central_limit(om.RayCamera(MOVING, SIZE, theta_max=REACH))
    assert (lens.theta_min, lens.theta_max) == (0.0, REACH)


def test_boards_stand_around_the_point_nearest_to_all_rays():
    """Those behind a mirror where the image shows them, with left and right exchanged."""
    system = off_focus().system
    views, _ = observe_boards(off_focus(), 6, noise=0.0, distance=(0.3, 0.8))
    found = in_central_frame(placed(system, views), system, views.pixels).points(views)[0]
    seen, _ = CentralLimit(system).unproject(views.pixels)
    along = (found * seen).sum(1) / np.linalg.norm(found, axis=1)
    assert np.degrees(np.arccos(along.min())) < 2.0


@pytest.fixture(scope="module")
def drawn_again():
    """Give a camera whose viewpoint moves, and what 80 calibrations of it found, each from other noise."""
    views, _ = observe_boards(om.RayCamera(MOVING, SIZE), 14, noise=0.0)
    central = calibrate(views, model="kannala_brandt", flat=True)
    trust = dataclasses.replace(central.quality, ceiling=None)
    tried = calibrate_rays(dataclasses.replace(central, trust=trust), unit="m").candidates
    start = next(c for c in tried if c.name == "axial kannala_brandt, 2")
    assert start.rms < 1e-6
    noise, found = np.random.default_rng(5), []
    for _ in range(80):
        seen = dataclasses.replace(views, pixels=views.pixels + NOISE * noise.standard_normal(views.pixels.shape))
        found.append((fit("again", start.state, seen, start.free_parameters, loss="huber"), seen))
    return found


def test_it_is_as_sure_of_what_is_far_as_calibrations_of_other_noise_agree(drawn_again):
    bearings = cap(REACH, 12)
    pixels, _ = LENS.project(bearings)
    inside = ((pixels > 0) & (pixels < SIZE)).all(1)
    bearings, pixels = bearings[inside], pixels[inside]
    off = [rotation_aligned_difference(CentralLimit(c.state.model), bearings, pixels) for c, _ in drawn_again]
    observed = np.sqrt((np.array(off) ** 2).sum(-1).mean())
    predicted = [Uncertainty.of(central_limit(ray_camera(*of))).projection(bearings) for of in drawn_again[:10]]
    stated = np.sqrt(np.trace(np.array(predicted), axis1=2, axis2=3).mean())
    assert stated / observed == pytest.approx(1.0, abs=0.15)


def test_it_is_as_sure_of_its_travel_as_calibrations_of_other_noise_agree(drawn_again):
    cone = 0.0, REACH
    lengths = [c.state.model.pupil_shift(*cone) for c, _ in drawn_again]
    cameras = [ray_camera(*of) for of in drawn_again[:10]]
    stated = [PupilShift.between(camera.model, camera.covariance, cone) for camera in cameras]
    assert stated[0].length == pytest.approx(lengths[0])
    assert np.mean([one.length_sigma for one in stated]) / np.std(lengths, ddof=1) == pytest.approx(1.0, abs=0.2)
    # Away from where places count from, none is surer than nearer to it.
    assert stated[0].sigma[0] == 0.0
    assert (np.diff(stated[0].sigma) > 0).all()


def ray_camera(candidate, views):
    covariance = camera_covariance(candidate, views)
    return om.RayCamera(candidate.state.model, SIZE, "m", theta_max=REACH, covariance=covariance)


def test_the_way_between_two_places_does_not_depend_on_where_they_count_from():
    covariance = np.diag([*np.zeros(8), 4e-8, 1e-8])
    theta = np.linspace(0.6, 1.4, 9)
    ways = [PupilShift.of(MOVING, covariance, theta, first) for first in (0.0, 0.6, 1.0)]
    for one in ways:
        assert one.length == pytest.approx(np.ptp(MOVING.start(theta)))
        assert one.length_sigma == pytest.approx(ways[0].length_sigma)
    np.testing.assert_allclose(ways[1].place, MOVING.start(theta) - MOVING.start(0.6), atol=1e-15)


def test_a_better_lens_is_no_moving_viewpoint():
    """It is compared with the same lens, its viewpoint standing still, where that is better than what was chosen."""
    views, _ = observe_boards(om.Camera(LENS, SIZE), 12, noise=0.2, distance=(0.15, 0.6))
    central = calibrate(views, model="equidistant", flat=True)
    found = calibrate_rays(central, unit="m")
    assert found.held_out_rms < 0.8 * central.held_out_rms
    assert found.central.name != "equidistant"
    assert found.central.held_out_rms < 0.8 * central.held_out_rms
    assert not found.needed
    assert not found.quality.noncentrality.needed
    # Of the same corners, wherever it is said.
    assert found.quality.noncentrality.central_rms == pytest.approx(found.central.held_out_rms)
    assert f"The central {found.central.name} has" in found.reason


def test_it_says_of_itself_what_it_says_of_a_central_camera():
    views, _ = observe_boards(pupil_shift_fisheye(), 9, noise=0.1)
    central = calibrate(views, model="kannala_brandt", flat=True)
    trust = dataclasses.replace(central.quality, ceiling=None)
    found = calibrate_rays(dataclasses.replace(central, trust=trust), unit="m")
    assert found.verdict is found.quality.verdict
    assert found.mean < found.rms < central.rms
    assert np.sqrt((found.residual_lengths**2).mean()) == pytest.approx(found.rms)
    assert found.quality.noncentrality.axial is found.candidates[0]
    assert found.quality.noncentrality.travel == pytest.approx(found.camera.calibration["travel"])
    assert found.quality.noncentrality.unit == "m"
    assert found.camera.calibration["uncertainty_px"] == found.quality.uncertainty.worst()[0]
    assert found.quality.coverage.corners[1:].sum() + found.quality.coverage.corners[0, 0] == len(views.pixels)
