"""Calibration of non-central cameras from exactly traced boards with noise."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import omnisight as om
from calibrating import calibrate, observe
from noncentral import (
    SIZE,
    TURN,
    calibrate_noncentral,
    in_focus,
    observe_boards,
    off_focus,
    projection_errors,
    pupil_shift_fisheye,
    sphere,
)
from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.candidate import Candidate
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.model_selection import CLAIM_SIGNIFICANCE, gain_p_value
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import MIN_OUTSIDE_COST_PX, State
from omnisight.geometry import rotation as so3
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.models.unified import Unified
from omnisight.optics.models.axial import Axial
from omnisight.quality.central_error import align_central
from omnisight.quality.noncentral_test import compare_central

NOISE = 0.1
# Root mean square length of a residual of pure noise, px.
NOISE_RMS = NOISE * np.sqrt(2)
# Cameras, and the central model closest to each: "auto" would select it in more time.
CASES = {"sphere": (sphere, "kannala_brandt"), "off_focus": (off_focus, "double_sphere")}
CASES["pupil_shift_fisheye"] = (pupil_shift_fisheye, "kannala_brandt")


@dataclasses.dataclass(frozen=True)
class Case:
    """A camera, its observations, the true corners, and both calibrations."""

    truth: object
    observations: om.Observations
    points: np.ndarray
    central: om.Calibration
    axial: om.Calibration


@pytest.fixture(scope="module", params=CASES)
def case(request):
    make, model = CASES[request.param]
    truth = make()
    views, points = observe_boards(truth, 14, noise=NOISE)
    central = calibrate(views, model=model, flat=True)
    return Case(truth, views, points, central, calibrate_noncentral(central))


def rms_error(calibration, truth, points, distance):
    """Return the rms projection error (px) at a distance along the true rays of the corners."""
    observations = calibration.observations
    estimated = calibration.state.points(observations)[0]
    errors = projection_errors(calibration.camera, truth, observations, estimated, points, distance)
    return np.sqrt((errors**2).mean())


def test_held_out_error_of_the_axial_model_is_that_of_the_noise(case):
    assert case.axial.quality.noncentrality.is_noncentral
    assert case.axial.rms < 1.03 * NOISE_RMS
    assert case.axial.held_out_rms < 1.06 * NOISE_RMS
    assert case.axial.held_out_rms < 0.9 * case.central.held_out_rms
    assert case.axial.best.name.startswith("axial ")
    assert case.axial.central.held_out_rms > case.axial.held_out_rms


@pytest.mark.parametrize("distance", [0.2, 0.5, 2.0])
def test_axial_camera_projects_as_the_true_camera(case, distance):
    axial = rms_error(case.axial, case.truth, case.points, distance)
    assert axial < 2.5 * NOISE
    assert axial < 0.3 * rms_error(case.central, case.truth, case.points, distance)


def test_noncentrality_test_is_positive(case):
    test = case.central.quality.noncentrality
    assert test.is_noncentral
    assert not test.is_inconclusive
    assert test.axial_rms < test.central_rms
    assert test.shift > 5 * test.shift_sigma
    assert str(test).startswith("the camera is non-central: held-out error 0.")
    assert f"{test.central_rms:.3f} px without" in str(test)
    assert [test.distance(k) for k in range(3)] == ["0.2 m", "1 m", "5 m"]
    # The central camera is accurate near the boards only.
    assert test.central_error.rms_pixels[2] > 3 * NOISE
    assert (test.central_error.max_pixels >= test.central_error.rms_pixels).all()


def test_verdict_of_the_central_camera_recommends_the_axial_model(case):
    reasons = " ".join(case.central.verdict.reasons)
    assert str(case.central.verdict) != "good"
    assert "use --model axial (tried: held-out error 0." in reasons
    assert "split-half difference " in reasons
    assert "--model spline" not in reasons
    assert "axial" not in " ".join(case.axial.verdict.reasons)
    assert [check.name for check in case.axial.verdict.checks if check.level] in ([], ["coverage"])
    # The model error does not apply to a non-central camera.
    assert "model error" not in {check.name for check in case.axial.verdict.checks}
    assert case.axial.camera.calibration["verdict"] == str(case.axial.verdict)
    assert case.axial.camera.calibration["reasons"] == list(case.axial.verdict.reasons)


def test_halves_of_the_images_agree_at_infinity(case):
    assert "split-half test" in {check.name for check in case.axial.verdict.checks}
    assert 0.3 < case.axial.quality.split_half.ratio < 2.0
    assert case.axial.quality.split_half.difference < 0.5 * case.central.quality.split_half.difference


def test_axial_camera_has_its_figures(case):
    camera = case.axial.camera
    assert camera.model.name == "axial"
    assert camera.unit == "m"
    assert camera.size == SIZE
    assert camera.calibration["pupil_shift"] == pytest.approx(
        camera.model.pupil_shift(camera.theta_min, camera.theta_max)
    )
    assert camera.covariance.shape == (camera.model.params.size,) * 2
    assert camera.calibration["central_held_out_rms"] == case.axial.central.held_out_rms
    assert camera.theta_max == pytest.approx(case.central.camera.theta_max, abs=0.15)
    assert camera.rays(case.observations.pixels).valid.all()


def test_noncentrality_test_of_a_central_camera_is_negative():
    observations, points = observe_boards(in_focus(), 10, noise=0.2)
    central = calibrate(observations, model="unified", flat=True)
    test = central.quality.noncentrality
    assert not test.is_noncentral
    assert test.shift < 4 * test.shift_sigma + 1e-4
    assert str(test).startswith("the images are consistent with a central camera: ")
    assert not calibrate_noncentral(central).quality.noncentrality.is_noncentral
    assert rms_error(central, in_focus(), points, 1.0) < 0.2


def test_noncentrality_test_is_inconclusive_for_a_large_shift_and_few_images():
    lens = KannalaBrandt(fx=380, fy=380, cx=641, cy=510, k1=-0.02, k2=0.004, k3=-0.001, k4=0.0)
    views, _ = observe_boards(om.RayCamera(Axial(lens, (0.008,)), SIZE), 6, noise=0.2, seed=2)
    test = calibrate(views, model="double_sphere", flat=True).quality.noncentrality
    assert test.axial_rms > test.central_rms
    assert test.shift > 5 * test.shift_sigma
    assert not test.is_noncentral
    assert test.is_inconclusive
    assert str(test).startswith("it is undecided whether the camera is central: ")
    assert "the shift is significant: more images" in str(test)


def test_model_error_is_not_mistaken_for_a_pupil_shift():
    lens = KannalaBrandt(fx=330, fy=330, cx=640, cy=512, k1=-0.06, k2=0.02, k3=-0.006, k4=0.0004)
    views, _ = observe_boards(om.Camera(lens, SIZE), 9, noise=0.2, reach=(0.0, 1.35), distance=(0.2, 0.6))
    test = calibrate(views, model="unified", flat=True).quality.noncentrality
    assert not test.is_noncentral


def test_designed_mirror_is_refined_to_its_true_pose():
    """The lens is not at its designed position, and off the axis: the camera is not axial."""
    truth = off_focus()
    values = truth.system.to_dict() | {"mirror_tx": 0.0012, "mirror_ty": -0.0008, "mirror_tilt_x": 0.01}
    system = type(truth.system).from_dict(values)
    truth = dataclasses.replace(truth, system=system)
    views, points = observe_boards(truth, 10, noise=NOISE)
    central = calibrate(views, model="double_sphere", flat=True)
    design = type(system).from_dict(off_focus().system.to_dict() | {"mirror_tz": system.to_dict()["mirror_tz"] + 0.002})
    found = calibrate_noncentral(central, design=design)
    assert found.held_out_rms < 0.9 * found.central.held_out_rms
    assert found.central is central.best
    assert found.rms < 1.03 * NOISE_RMS
    sigma = dict(zip(system.param_names, np.sqrt(np.diagonal(found.camera.covariance)), strict=True))
    for name in ("mirror_tz", "fx"):
        assert abs(found.camera.model.to_dict()[name] - system.to_dict()[name]) < 5 * sigma[name]
    assert rms_error(found, system, points @ TURN + truth.vertex, 1.0) < 3 * NOISE


def test_sphere_is_refined_from_boards_near_its_rim():
    """Corners beyond the designed rim are used, and rotations of a sphere, which have no effect, stay as designed."""
    truth, design = sphere(), sphere().system.to_dict()
    views, points = observe_boards(truth, 8, noise=NOISE, reach=(0.6, 2.2), seed=4)
    central = calibrate(views, model="kannala_brandt", flat=True)
    system = type(truth.system).from_dict
    moved = {"mirror_tz": 0.103, "mirror_tx": 0.001, "fx": 1545.0, "fy": 1545.0, "mirror_tilt_x": 0.02}
    found = calibrate_noncentral(central, design=system(design | moved))
    assert found.rms < 1.03 * NOISE_RMS
    values = found.camera.model.to_dict()
    assert (values["mirror_tilt_x"], values["mirror_tilt_y"]) == (0.02, 0.0)
    assert values["mirror_rim"] == pytest.approx(design["mirror_rim"], rel=0.03)
    assert found.camera.rays(views.pixels).valid.all()
    assert rms_error(found, truth.system, points @ TURN + truth.vertex, 0.5) < 3 * NOISE
    with pytest.raises(ValueError, match="mirror, distance or focal length differ from the design"):
        calibrate_noncentral(central, design=system(design | {"mirror_radius": 0.1, "mirror_rim": 0.09}))
    with pytest.raises(ValueError, match="% of the corners: its focal length"):
        calibrate_noncentral(central, design=system(design | {"fx": 400.0, "fy": 400.0}))


def test_lengths_are_in_the_unit_of_the_board():
    views, _ = observe_boards(pupil_shift_fisheye(), 7, noise=NOISE)
    squares = dataclasses.replace(views, points=views.points / 0.03, extent=views.extent / 0.03, unit="squares")
    metres, boards = (
        calibrate(observations, model="kannala_brandt", flat=True).quality.noncentrality
        for observations in (views, squares)
    )
    assert boards.shift == pytest.approx(metres.shift / 0.03, rel=0.01)
    assert [boards.distance(k) for k in range(3)] == ["1 board width", "5 board widths", "25 board widths"]
    np.testing.assert_allclose(boards.central_error.distances, 8 * np.array([1, 5, 25]))
    assert boards.as_dict()["unit"] == "squares"


def test_aligned_central_camera_recovers_a_rigid_motion():
    lens = Unified.example()
    model = Axial(lens, (0.0,))
    points = np.random.default_rng(0).normal((0, 0, 2), 1, (300, 3))
    assert np.abs(align_central(lens, model, points).translation).max() < 1e-12
    rotation = so3.exp([0.01, -0.02, 0.03])
    pixels, _ = lens.project(points)

    class Moved:
        """The camera at another pose."""

        def project_numpy(self, points):
            return lens.project_numpy(points @ rotation.T + (0.01, 0.0, -0.02))

    pose = align_central(lens, Moved(), points)
    np.testing.assert_allclose(pose.rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(pose.translation, (0.01, 0.0, -0.02), atol=1e-9)
    assert np.isfinite(pixels).any()


def test_contradicting_options_are_errors():
    with pytest.raises(ValueError, match=r"design\.json contains its model: leave out --model axial"):
        om.CalibrateOptions(start=Path("design.json"), model="axial")
    with pytest.raises(ValueError, match="leave out --model axial and --start"):
        om.CalibrateOptions(model="axial", method="ocamcalib")


def test_start_file_of_another_camera_is_an_error(case, tmp_path):
    central, small, squares = (tmp_path / f"{name}.json" for name in ("central", "small", "squares"))
    om.save(case.central.camera, central)
    with pytest.raises(ValueError, match=r"central\.json: a central camera"):
        calibrate(case.observations, start=central)
    om.save(om.RayCamera(off_focus().system, (640, 512), unit="m"), small)
    with pytest.raises(ValueError, match=r"small\.json: for images of 640x512 px; these are 1280x1024 px"):
        calibrate(case.observations, start=small)
    om.save(om.RayCamera(off_focus().system, SIZE, unit="squares"), squares)
    with pytest.raises(ValueError, match=r"squares\.json: lengths are in squares, those of the board in m"):
        calibrate(case.observations, start=squares)


def test_calibrate_accepts_a_design_as_a_start_file(tmp_path):
    truth = off_focus()
    observations, points = observe_boards(truth, 8, noise=NOISE, reach=(0.15, 1.4))
    design = type(truth.system).from_dict(
        truth.system.to_dict() | {"mirror_tz": truth.system.to_dict()["mirror_tz"] + 0.001}
    )
    om.save(om.RayCamera(design, SIZE, unit="m"), tmp_path / "design.json")
    calibration = calibrate(observations, start=tmp_path / "design.json", flat=True)
    assert isinstance(calibration.camera, om.RayCamera)
    assert calibration.rms < 1.03 * NOISE_RMS
    assert rms_error(calibration, truth.system, points @ TURN + truth.vertex, 1.0) < 3 * NOISE


def test_calibrate_accepts_the_axial_model():
    truth = pupil_shift_fisheye()
    observations, points = observe_boards(truth, 14, noise=NOISE)
    calibration = calibrate(observations, model="axial", flat=True)
    assert isinstance(calibration.camera, om.RayCamera)
    assert calibration.camera.model.name == "axial"
    assert calibration.held_out_rms < 1.1 * NOISE_RMS
    assert calibration.held_out_rms < 0.9 * calibration.central.held_out_rms
    assert rms_error(calibration, truth, points, 1.0) < 3 * NOISE


def test_corners_invisible_in_a_mirror_have_a_constant_cost():
    """The cost is not lower near the blind spot in the image centre."""
    system = off_focus().system
    board = np.array([[x, y, 0.0] for y in range(2) for x in range(3)]) * 0.03
    views = observe([(board, np.array([640.0, 512.0]) + 100 * board[:, :2])], SIZE)
    costs = []
    for x in (0.0, 0.1, 0.2):
        # In front of the mirror, where nothing is visible.
        state = State(system, np.eye(3)[None], np.array([[x, 0.4, 0.9]]))
        assert not system.project(state.points(views)[0])[1].any()
        bundle = Bundle(views, FreeParameters.none(system), ResidualWeights(np.tile(np.eye(2), (6, 1, 1)), 1.0, 5.0))
        costs.append(bundle.cost(state))
        assert not bundle.linearize(state).local_gradient.any()
    assert costs[0] > 6 * 5 * MIN_OUTSIDE_COST_PX / 2
    assert costs == [costs[0]] * 3


@pytest.mark.parametrize("model", ["radial_polynomial", "equidistant"])
def test_a_central_camera_is_not_called_noncentral_because_of_a_poor_model(model):
    lens = KannalaBrandt(fx=330, fy=330, cx=640, cy=512, k1=-0.06, k2=0.02, k3=-0.006, k4=0.0004)
    views, _ = observe_boards(om.Camera(lens, SIZE), 8, noise=0.2, reach=(0.0, 1.2), distance=(0.2, 0.6))
    calibration = calibrate(views, model=model, flat=True)
    assert not calibration.quality.noncentrality.is_noncentral
    assert "--model axial" not in " ".join(calibration.reasons)


def test_noncentrality_is_not_claimed_without_the_spline_baseline(case):
    test = case.central.quality.noncentrality
    inliers, camera = ~case.central.outliers, case.axial.camera
    central = case.central.best
    axial = test.axial
    without = compare_central(central, axial, camera, case.observations, inliers, None)
    assert without.p_value < CLAIM_SIGNIFICANCE
    assert not without.is_noncentral
    assert without.is_inconclusive
    assert "without a reliable spline baseline, the lens model may be the cause" in str(without)


@pytest.mark.parametrize(
    ("gains", "expected"),
    # Sums of ranks as high as these have 1, 2 and 5 of the 16 choices of the signs.
    [((1.0, 2.0, 3.0, 4.0), 1 / 16), ((-1.0, 2.0, 3.0, 4.0), 2 / 16), ((-1.0, -2.0, 3.0, 400.0), 5 / 16)],
)
def test_p_value_of_a_gain_is_that_of_the_signed_rank_test(gains, expected):
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    views = observe([(points, 10 + 100 * points[:, :2] + k) for k in range(len(gains))], SIZE)
    lens = KannalaBrandt.example()
    state = State(lens, np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3)))
    candidate = Candidate("lens", state, FreeParameters.of(lens), 16, 1.0, 1.0)
    squares = 1.0 + np.repeat(np.array(gains) - min(gains), 4), np.full(16, 1.0 - min(gains))
    one, other = (dataclasses.replace(candidate, held_out_lengths=np.sqrt(s)) for s in squares)
    assert gain_p_value(other, one, views, np.ones(16, bool)) == pytest.approx(expected)
