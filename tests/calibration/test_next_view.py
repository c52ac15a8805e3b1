"""Proposal of the next image: predictions are met, and the unobserved part of the image is filled first."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from calibrating import SIZE
from lenses import BOARD, CENTRE, RIM, lens, rotation_to
from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State
from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.images import ImageField
from omnisight.images.ellipse import Ellipse
from omnisight.models import model_class
from omnisight.quality.uncertainty import Uncertainty
from omnisight.targets.observations import Observations
from omnisight.view_planning.board_placements import BoardPlacements
from omnisight.view_planning.information_prior import InformationPrior, estimated_parameters
from omnisight.view_planning.proposal import UNKNOWN_ERROR_PX, add_placement, propose_views, worst_direction
from omnisight.view_planning.visible_directions import VisibleDirections

NOISE = 0.15
FIELD = ImageField(SIZE, Ellipse(CENTRE, (RIM, RIM)))
LENS, MIRROR = lens(200), lens(280)


def observe(shots, extent=None):
    points, pixels = zip(*shots, strict=True) if shots else ((), ())
    return Observations.from_arrays(points, pixels, size=SIZE, extent=extent)


def random_placement(theta, phi, distance, rng):
    """Return a pose of the board in a direction, tilted by 30 to 45 degrees about a random axis."""
    towards = polar(np.array(theta), np.array(phi))
    lean = rng.uniform(0, 2 * np.pi)
    tilt = rng.uniform(0.5, 0.8) * np.array([np.cos(lean), np.sin(lean), 0.0])
    rotation = rotation_to(towards) @ so3.exp([0.0, 0.0, rng.uniform(-3, 3)]) @ so3.exp(tilt)
    return rotation, distance * towards - rotation @ BOARD.points.mean(0)


def photograph(model, pose, rng, field=FIELD, noise=NOISE):
    """Return the board points inside the image circle and their noisy pixels in the true camera."""
    rotation, translation = pose
    pixels, valid = model.project(BOARD.points @ rotation.T + translation)
    pixels = pixels + rng.normal(0, noise, pixels.shape)
    seen = valid & field.contains(pixels, 4)
    return BOARD.points[seen], pixels[seen]


def random_placements(rng, count=10, theta=(0.0, 1.2), phi=(0.0, 2 * np.pi)):
    """Return random poses over a part of the field of view."""
    return [random_placement(rng.uniform(*theta), rng.uniform(*phi), rng.uniform(9, 16), rng) for _ in range(count)]


def prior_of(model, poses, rng, field=FIELD, noise=NOISE):
    """Calibrate on images of boards at some poses; return the prior and the images."""
    shots = [photograph(model, pose, rng, field, noise) for pose in poses]
    shots = [shot for shot in shots if len(shot[0]) >= 12]
    return InformationPrior.estimate(Camera(model, SIZE), observe(shots)), shots


@cache
def scene(name):
    """Return the prior and the images of the lens: boards all around, in the centre only, or on the right."""
    rng = np.random.default_rng(5)
    part = {"around": {}, "middle": {"theta": (0.0, 0.15)}, "right": {"theta": (0.3, 1.2), "phi": (-0.6, 0.6)}}[name]
    return prior_of(LENS, random_placements(rng, **part), rng)


def centre_of(view):
    return view.cam_from_board @ BOARD.points.mean(0)


def follow_proposal(prior, view):
    """Return the pose of a user who follows a proposal: centre at that pixel, that distance, that tilt."""
    middle = centre_of(view)
    pixel, _ = prior.camera.project(middle)
    bearing, valid = LENS.unproject(pixel)
    assert valid
    turn = rotation_to(bearing) @ rotation_to(middle / np.linalg.norm(middle)).T
    rotation = turn @ view.cam_from_board.rotation
    return rotation, np.linalg.norm(middle) * bearing - rotation @ BOARD.points.mean(0)


def achieved_error(shots, pose, seed):
    """Return the worst error after refining the camera with a simulated image of the board at a pose."""
    after = InformationPrior.estimate(
        Camera(LENS, SIZE), observe([*shots, photograph(LENS, pose, np.random.default_rng(seed))])
    )
    return worst_direction(after, VisibleDirections.sample(after, FIELD)).error_px


@pytest.mark.parametrize("name", ["around", "right"])
def test_the_predicted_error_is_achieved_and_beats_random_images(name):
    prior, shots = scene(name)
    (view,) = propose_views(prior, BOARD, FIELD, 1).views
    achieved = np.mean([achieved_error(shots, follow_proposal(prior, view), seed) for seed in range(3)])
    rng = np.random.default_rng(8)
    anywhere = np.mean([achieved_error(shots, pose, 0) for pose in random_placements(rng, 6, theta=(0.0, 1.7))])
    assert achieved == pytest.approx(view.after.error_px, rel=0.2)
    assert achieved < 0.5 * view.before.error_px
    assert achieved < 0.5 * anywhere


def test_three_proposed_images_determine_the_edge_of_a_central_set():
    """The first prediction is an extrapolation; each image improves it."""
    prior, shots = scene("middle")
    rng = np.random.default_rng(6)
    assert worst_direction(prior, VisibleDirections.sample(prior, FIELD)).error_px > UNKNOWN_ERROR_PX
    anywhere = [*shots, *(photograph(LENS, pose, rng) for pose in random_placements(rng, 3, theta=(0.0, 1.7)))]
    followed = list(shots)
    for _ in range(3):
        (view,) = propose_views(prior, BOARD, FIELD, 1).views
        followed.append(photograph(LENS, follow_proposal(prior, view), rng))
        prior = InformationPrior.estimate(Camera(LENS, SIZE), observe(followed))
    error = worst_direction(prior, VisibleDirections.sample(prior, FIELD)).error_px
    other = InformationPrior.estimate(Camera(LENS, SIZE), observe(anywhere))
    assert error < 0.5
    assert error < 0.5 * worst_direction(other, VisibleDirections.sample(other, FIELD)).error_px


def test_a_central_set_gets_a_proposal_at_the_edge():
    prior, _ = scene("middle")
    (view,) = propose_views(prior, BOARD, FIELD, 1).views
    board = angle_from_axis(view.cam_from_board @ BOARD.points)
    assert angle_from_axis(centre_of(view)) > prior.theta_max
    assert board.max() > prior.theta_max + np.radians(30)
    assert not view.before.is_calibrated


def test_a_one_sided_set_gets_a_proposal_on_the_other_side():
    prior, _ = scene("right")
    corners, _ = prior.state.points(prior.observations)
    seen = np.arctan2(corners[:, 1], corners[:, 0])
    assert np.degrees(np.abs(seen[angle_from_axis(corners) > 0.6])).max() < 80
    (view,) = propose_views(prior, BOARD, FIELD, 1).views
    x, y, _ = centre_of(view)
    assert np.degrees(np.abs(np.arctan2(y, x))) > 80


def test_each_proposal_continues_from_the_previous_one():
    prior, _ = scene("around")
    proposal = propose_views(prior, BOARD, FIELD, 3)
    assert len(proposal.views) == 3
    assert proposal.views[0].before == proposal.worst
    for earlier, later in pairwise(proposal.views):
        assert later.before is earlier.after
        assert later.after.error_px < earlier.after.error_px
        assert later.after.rms_px < earlier.after.rms_px
    # The prediction of the first does not depend on the later ones.
    assert propose_views(prior, BOARD, FIELD, 1).views[0].after.error_px == proposal.views[0].after.error_px
    assert not proposal.is_sufficient


def test_the_information_of_a_placement_is_the_gain_of_the_normal_equations():
    prior, _ = scene("around")
    rotation, translation = random_placement(0.9, 2.0, 14.0, np.random.default_rng(3))
    placement = BoardPlacements.single(prior, BOARD, FIELD, rotation, translation)
    assert placement.visible_fraction[0] == 1.0
    points = BOARD.points
    pixels, _ = prior.camera.model.project(points @ rotation.T + translation)
    views = observe([(points, pixels)], extent=prior.observations.extent)
    state = State(prior.camera.model, rotation[None], translation[None])
    plain = ResidualWeights(np.broadcast_to(np.eye(2), (len(points), 2, 2)), 1.0, np.inf)
    normal = Bundle(views, FreeParameters(prior.free_parameters.directions), plain).linearize(state)
    gained = normal.reduced()[0] / prior.noise_variance
    scale = 1 / np.sqrt(np.diagonal(gained))
    np.testing.assert_allclose(
        scale[:, None] * placement.information[0] * scale, scale[:, None] * gained * scale, atol=1e-6
    )


def test_errors_agree_with_the_uncertainty_of_the_calibration():
    prior, _ = scene("around")
    visible = VisibleDirections.sample(prior, FIELD)
    # The covariance of the prior, without the inflation of the file's covariance.
    half = prior.camera_basis @ prior.covariance_root
    covariance = half @ half.T
    reach = float(visible.thetas[visible.thetas <= prior.theta_max][-1])
    camera = replace(prior.camera, covariance=covariance, theta_max=reach)
    expected = np.sqrt(np.trace(Uncertainty.of(camera).projection(visible.bearings), axis1=1, axis2=2))
    np.testing.assert_allclose(visible.errors(prior, reach), expected, rtol=0.05)
    np.testing.assert_allclose(visible.errors_at(prior, visible.bearings), visible.errors(prior, prior.theta_max))


def test_batch_evaluation_agrees_with_single_placements():
    prior, _ = scene("middle")
    visible = VisibleDirections.sample(prior, FIELD)
    boards = BoardPlacements.sample(prior, BOARD, FIELD)
    assert 500 < len(boards.tilt) < 3000
    indices = np.random.default_rng(0).choice(len(boards.tilt), 5, replace=False)
    reaches = np.maximum(boards.theta_max[indices], prior.theta_max)
    together = visible.errors_with_added(prior, boards.information[indices], reaches)
    for row, i in zip(together, indices, strict=True):
        after = add_placement(prior, BOARD, FIELD, boards.rotations[i], boards.translations[i])
        np.testing.assert_allclose(row, visible.errors(after, after.theta_max), rtol=1e-4)


def test_placements_show_at_least_a_third_of_the_corners():
    prior, _ = scene("around")
    boards = BoardPlacements.sample(prior, BOARD, FIELD)
    assert len(boards.tilt) > 500
    for rotation, translation, part in zip(boards.rotations, boards.translations, boards.visible_fraction, strict=True):
        pixels, valid = prior.camera.project(BOARD.points @ rotation.T + translation)
        inside = valid & FIELD.contains(pixels, 4)
        assert inside.mean() >= part >= 1 / 3
    middles = boards.translations + boards.rotations @ BOARD.points.mean(0)
    # The printed side faces the camera.
    assert (np.einsum("ki,ki->k", boards.rotations[:, :, 2], middles) > 0).all()
    assert np.degrees(np.unique(boards.tilt.round(6))) == pytest.approx([0, 30, 45])


def test_no_placement_lies_in_the_blind_spot_of_a_mirror():
    field = replace(FIELD, inner=Ellipse(CENTRE, (120.0, 120.0)))
    rng = np.random.default_rng(1)
    prior, _ = prior_of(MIRROR, random_placements(rng, 10, theta=(1.0, 1.6)), rng, field)
    proposal = propose_views(prior, BOARD, field, 2)
    assert proposal.views
    for view in proposal.views:
        pixel, valid = prior.camera.project(centre_of(view))
        assert valid
        assert field.contains(pixel)
        assert view.after.error_px < view.before.error_px
    assert field.contains(proposal.directions.pixels).all()


def test_an_accurate_camera_needs_no_more_images():
    rng = np.random.default_rng(2)
    prior, _ = prior_of(LENS, random_placements(rng, 20, theta=(0.0, 1.7)), rng, noise=0.05)
    proposal = propose_views(prior, BOARD, FIELD, 1)
    assert proposal.worst.error_px < 0.2
    assert proposal.is_sufficient


def test_proposals_after_two_central_images_reduce_the_unprior_part():
    rng = np.random.default_rng(4)
    prior, _ = prior_of(LENS, random_placements(rng, 2, theta=(0.0, 0.1)), rng)
    proposal = propose_views(prior, BOARD, FIELD, 3)
    assert proposal.worst.error_px > UNKNOWN_ERROR_PX
    means = [proposal.worst.rms_px, *(view.after.rms_px for view in proposal.views)]
    assert all(later < earlier for earlier, later in pairwise(means))
    assert np.isfinite(means).all()
    assert proposal.views[-1].after.error_px < UNKNOWN_ERROR_PX


def test_the_estimated_parameters_follow_the_calibration():
    model = model_class("kannala_brandt").example()
    still = np.zeros((model.params.size, model.params.size))
    moving = [model.param_names.index(name) for name in ("fx", "fy", "cx", "k1")]
    still[moving, moving] = 1.0
    free_parameters = estimated_parameters(
        Camera(model, SIZE, covariance=still, calibration={"board_warp": [0.0, 0.0]})
    )
    assert free_parameters.warp
    assert np.flatnonzero(free_parameters.directions.any(1)).tolist() == sorted(moving)
    square = still.copy()
    square[moving[0], moving[1]] = square[moving[1], moving[0]] = 1.0
    assert estimated_parameters(Camera(model, SIZE, covariance=square)).directions.shape[1] == 3
    assert estimated_parameters(Camera(model, SIZE)).directions.shape[1] == FreeParameters.of(model).directions.shape[1]


def test_a_camera_of_other_images_is_rejected():
    _, shots = scene("around")
    views = observe(shots)
    with pytest.raises(ValueError, match="no image shows the board"):
        InformationPrior.estimate(Camera(LENS, SIZE), observe([]))
    pinhole = model_class("pinhole").from_dict({"fx": 300, "fy": 300, "cx": 480, "cy": 480, "skew": 0})
    with pytest.raises(ValueError, match="does not fit these images: the median residual is"):
        InformationPrior.estimate(Camera(pinhole, SIZE), views)
