"""Cameras whose rays do not meet in a point, calibrated from boards that were traced exactly."""

import dataclasses

import numpy as np
import pytest

import omnisight as om
from calibrating import calibrate, observe
from noncentral import SIZE, TURN, in_focus, observe_boards, off_focus, projection_errors, pupil_shift_fisheye, sphere
from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX, State
from omnisight.geometry import rotation as so3
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.unified import Unified
from omnisight.optics.models.axial import Axial
from omnisight.quality.central_error import aligned
from omnisight.quality.noncentral_test import evaluate_noncentrality

NOISE = 0.1
# Length of a corner's residual, px, where nothing but noise is left.
EXPECTED = NOISE * np.sqrt(2)
# What is calibrated, with the lens that is nearest to it: "auto" finds as much in more time.
CASES = {"sphere": (sphere, "kannala_brandt"), "off_focus": (off_focus, "double_sphere")}
CASES["pupil_shift_fisheye"] = (pupil_shift_fisheye, "kannala_brandt")


@dataclasses.dataclass(frozen=True)
class Case:
    """A camera, what it saw, and both calibrations."""

    truth: object
    views: om.Observations
    points: np.ndarray
    central: om.Calibration
    rays: object


def without_spline(calibration):
    """Leave out the lens that takes longest to try."""
    return dataclasses.replace(calibration, trust=dataclasses.replace(calibration.quality, ceiling=None))


@pytest.fixture(scope="module", params=CASES)
def case(request):
    make, model = CASES[request.param]
    truth = make()
    views, points = observe_boards(truth, 14, noise=NOISE)
    central = calibrate(views, model=model, flat=True)
    return Case(truth, views, points, central, calibrate_rays(without_spline(central), unit="m"))


def test_pictures_held_out_are_explained_to_noise(case):
    assert case.rays.needed
    assert case.rays.rms < 1.03 * EXPECTED
    assert case.rays.held_out_rms < 1.06 * EXPECTED
    assert case.rays.held_out_rms < 0.9 * case.central.held_out_rms
    assert "axial" in case.rays.reason


@pytest.mark.parametrize("distance", [0.2, 0.5, 2.0])
def test_the_rays_are_the_true_ones(case, distance):
    about = case.truth, case.views
    found = case.rays.state.points(case.views)[0]
    off = projection_errors(case.rays.camera, *about, found, case.points, distance)
    central = projection_errors(
        case.central.camera, *about, case.central.state.points(case.views)[0], case.points, distance
    )
    assert np.sqrt((off**2).mean()) < 2.5 * NOISE
    assert np.sqrt((off**2).mean()) < 0.3 * np.sqrt((central**2).mean())


def test_the_data_ask_for_it(case):
    asked = evaluate_noncentrality(case.central, unit="m")
    assert asked.needed
    assert not asked.open
    assert asked.axial_rms < asked.central_rms
    assert asked.travel > 5 * asked.travel_sigma
    assert str(asked).startswith("the rays do not meet in a point: images held out are 0.")
    assert f"{asked.central_rms:.3f} px if it stands still" in str(asked)
    assert [asked.distance(k) for k in range(3)] == ["0.2 m", "1 m", "5 m"]
    # Near the boards it is right, far from them it is not.
    assert asked.left.rms_pixels[2] > 3 * NOISE
    assert (asked.left.max_pixels >= asked.left.rms_pixels).all()


def test_the_verdict_of_the_central_camera_names_the_axial_one_and_that_of_the_axial_one_does_not(case):
    reasons = " ".join(case.central.verdict.reasons)
    assert str(case.central.verdict) != "good"
    assert "use --model axial" in reasons
    assert "--model spline" not in reasons
    assert "axial" not in " ".join(case.rays.verdict.reasons)
    assert [check.name for check in case.rays.verdict.checks if check.level] in ([], ["coverage"])
    # What was not looked at is not said to be good.
    assert "model" not in {check.name for check in case.rays.verdict.checks}
    assert case.rays.camera.calibration["verdict"] == str(case.rays.verdict)
    assert case.rays.camera.calibration["reasons"] == list(case.rays.verdict.reasons)


def test_two_halves_of_the_pictures_agree_about_what_is_far_as_noise_has_it(case):
    assert "halves" in {check.name for check in case.rays.verdict.checks}
    assert 0.3 < case.rays.quality.split_half.ratio < 2.0
    assert case.rays.quality.split_half.difference < 0.5 * case.central.quality.split_half.difference


def test_a_camera_of_rays_knows_what_it_is(case):
    camera = case.rays.camera
    assert camera.model.name == "axial"
    assert camera.unit == "m"
    assert camera.size == SIZE
    assert camera.calibration["travel"] == pytest.approx(camera.model.pupil_shift(camera.theta_min, camera.theta_max))
    assert camera.covariance.shape == (camera.model.params.size,) * 2
    assert camera.calibration["central_held_out_rms"] == case.rays.central.held_out_rms
    assert camera.theta_max == pytest.approx(case.central.camera.theta_max, abs=0.15)
    seen = camera.rays(case.views.pixels)
    assert seen.valid.all()


def test_a_camera_whose_rays_meet_stays_central():
    views, points = observe_boards(in_focus(), 10, noise=0.2)
    central = calibrate(views, model="unified", flat=True)
    asked = evaluate_noncentrality(central, unit="m")
    assert not asked.needed
    assert asked.travel < 4 * asked.travel_sigma + 1e-4
    assert str(asked).startswith("the rays meet in a point, as far as these images tell")
    found = calibrate_rays(without_spline(central), unit="m")
    assert not found.needed
    assert "nothing here asks for more" in found.reason
    off = projection_errors(central.camera, in_focus(), views, central.state.points(views)[0], points, 1.0)
    assert np.sqrt((off**2).mean()) < 0.2


def test_few_pictures_leave_a_large_travel_open():
    lens = KannalaBrandt(fx=380, fy=380, cx=641, cy=510, k1=-0.02, k2=0.004, k3=-0.001, k4=0.0)
    views, _ = observe_boards(om.RayCamera(Axial(lens, (0.008,)), SIZE), 6, noise=0.2, seed=2)
    asked = evaluate_noncentrality(calibrate(views, model="double_sphere", flat=True), unit="m")
    assert asked.axial_rms > asked.central_rms
    assert asked.travel > 5 * asked.travel_sigma
    assert (asked.needed, asked.open) == (False, True)
    assert str(asked).startswith("it is open whether the rays meet in a point: ")
    assert "so large a travel is no chance" in str(asked)


def test_a_lens_that_is_too_poor_is_no_moving_viewpoint():
    lens = KannalaBrandt(fx=330, fy=330, cx=640, cy=512, k1=-0.06, k2=0.02, k3=-0.006, k4=0.0004)
    views, _ = observe_boards(om.Camera(lens, SIZE), 9, noise=0.2, reach=(0.0, 1.35), distance=(0.2, 0.6))
    asked = evaluate_noncentrality(calibrate(views, model="unified", flat=True), unit="m")
    assert not asked.needed


def test_a_mirror_from_its_drawing_is_refined_where_it_stands():
    """A lens that is not where it should be, and beside the axis: its rays meet no axis."""
    truth = off_focus()
    values = truth.system.to_dict() | {"mirror_tx": 0.0012, "mirror_ty": -0.0008, "mirror_tilt_x": 0.01}
    system = type(truth.system).from_dict(values)
    truth = dataclasses.replace(truth, system=system)
    views, points = observe_boards(truth, 10, noise=NOISE)
    central = calibrate(views, model="double_sphere", flat=True)
    drawing = type(system).from_dict(
        off_focus().system.to_dict() | {"mirror_tz": system.to_dict()["mirror_tz"] + 0.002}
    )
    found = calibrate_rays(central, drawing, unit="m")
    assert found.needed
    assert found.rms < 1.03 * EXPECTED
    sigma = dict(zip(system.param_names, np.sqrt(np.diagonal(found.camera.covariance)), strict=True))
    for name, value in found.camera.model.to_dict().items():
        if name in ("mirror_tz", "fx"):
            assert abs(value - system.to_dict()[name]) < 5 * sigma[name]
    there = points @ TURN + truth.vertex
    off = projection_errors(found.camera, system, views, found.state.points(views)[0], there, 1.0)
    assert np.sqrt((off**2).mean()) < 3 * NOISE


def test_a_ball_is_found_from_boards_at_its_rim_although_it_is_drawn_elsewhere():
    """Corners beyond the drawn rim lead on, and turns of a ball, which change nothing, stay as drawn."""
    truth, drawn = sphere(), sphere().system.to_dict()
    views, points = observe_boards(truth, 8, noise=NOISE, reach=(0.6, 2.2), seed=4)
    central = calibrate(views, model="kannala_brandt", flat=True)
    moved = {"mirror_tz": 0.103, "mirror_tx": 0.001, "fx": 1545.0, "fy": 1545.0, "mirror_tilt_x": 0.02}
    found = calibrate_rays(central, type(truth.system).from_dict(drawn | moved), unit="m")
    assert found.rms < 1.03 * EXPECTED
    values = found.camera.model.to_dict()
    assert (values["mirror_tilt_x"], values["mirror_tilt_y"]) == (0.02, 0.0)
    assert values["mirror_rim"] == pytest.approx(drawn["mirror_rim"], rel=0.03)
    assert found.camera.rays(views.pixels).valid.all()
    there = points @ TURN + truth.vertex
    off = projection_errors(found.camera, truth.system, views, found.state.points(views)[0], there, 0.5)
    assert np.sqrt((off**2).mean()) < 3 * NOISE
    # Twice as large, it is no such camera, and says so.
    with pytest.raises(ValueError, match="its mirror, distance or focal length is not what was drawn"):
        calibrate_rays(central, type(truth.system).from_dict(drawn | {"mirror_radius": 0.1, "mirror_rim": 0.09}))
    with pytest.raises(ValueError, match="% of the corners: its focal length"):
        calibrate_rays(central, type(truth.system).from_dict(drawn | {"fx": 400.0, "fy": 400.0}))


def test_lengths_follow_the_board():
    views, _ = observe_boards(pupil_shift_fisheye(), 7, noise=NOISE)
    squares = dataclasses.replace(views, points=views.points / 0.03, extent=views.extent / 0.03)
    metres, boards = (
        evaluate_noncentrality(calibrate(v, model="kannala_brandt", flat=True), unit=unit)
        for v, unit in ((views, "m"), (squares, "squares"))
    )
    assert boards.travel == pytest.approx(metres.travel / 0.03, rel=0.01)
    assert [boards.distance(k) for k in range(3)] == ["1 board width", "5 board widths", "25 board widths"]
    np.testing.assert_allclose(boards.left.distances, 8 * np.array([1, 5, 25]))
    assert boards.as_dict()["unit"] == "squares"


def test_a_central_camera_is_aligned_with_itself_moved():
    lens = Unified.example()
    model = Axial(lens, (0.0,))
    points = np.random.default_rng(0).normal((0, 0, 2), 1, (300, 3))
    assert np.abs(aligned(lens, model, points).translation).max() < 1e-12
    turned = so3.exp([0.01, -0.02, 0.03])
    pixels, _ = lens.project(points)

    class Seen:
        """An axial camera that stands elsewhere."""

        def project_numpy(self, there):
            return lens.project_numpy(there @ turned.T + (0.01, 0.0, -0.02))

    pose = aligned(lens, Seen(), points)
    np.testing.assert_allclose(pose.rotation, turned, atol=1e-9)
    np.testing.assert_allclose(pose.translation, (0.01, 0.0, -0.02), atol=1e-9)
    assert np.isfinite(pixels).any()


def test_an_unknown_model_is_refused(case):
    with pytest.raises(ValueError, match="unknown non-central model 'nonsense'"):
        calibrate_rays(case.central, "nonsense")


def test_a_corner_that_a_mirror_does_not_show_costs_the_same_wherever_it_is():
    """Not less where it comes near to what the image shows in its middle: the camera itself."""
    system = off_focus().system
    board = np.array([[x, y, 0.0] for y in range(2) for x in range(3)]) * 0.03
    costs = []
    for x in (0.0, 0.1, 0.2):
        # Before the mirror, in front of which nothing is seen.
        state = State(system, np.eye(3)[None], np.array([[x, 0.4, 0.9]]))
        assert not system.project(state.points(observe([(board, board[:, :2])]))[0])[1].any()
        views = observe([(board, np.tile([640.0, 512.0], (6, 1)))])
        bundle = Bundle(views, FreeParameters.none(system), ResidualWeights(np.tile(np.eye(2), (6, 1, 1)), 1.0, 5.0))
        costs.append(bundle.cost(state))
        assert not bundle.linearize(state).local_gradient.any()
    assert costs[0] > 6 * 5 * MIN_OUTSIDE_COST_PX / 2
    assert costs == [costs[0]] * 3
