"""Where to hold the board next: what is promised comes true, and the empty part of the image is filled first."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lenses import BOARD, CENTRE, RIM, SIZE, rotation_to, lens
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
from omnisight.next_view.board_placements import BoardPlacements
from omnisight.next_view.information_prior import InformationPrior, estimated
from omnisight.next_view.proposal import UNKNOWN_PX, propose, with_board, worst
from omnisight.next_view.visible_directions import VisibleDirections
from omnisight.quality.uncertainty import Uncertainty
from omnisight.targets.observations import Observations

NOISE = 0.15
FIELD = ImageField(SIZE, Ellipse(CENTRE, (RIM, RIM)))
LENS, MIRROR = lens(200), lens(280)


def held(theta, phi, distance, rng):
    """Hold the board in a direction, tilted by 30 to 45 degrees to some side."""
    towards = polar(np.array(theta), np.array(phi))
    lean = rng.uniform(0, 2 * np.pi)
    tilt = rng.uniform(0.5, 0.8) * np.array([np.cos(lean), np.sin(lean), 0.0])
    rotation = rotation_to(towards) @ so3.exp([0.0, 0.0, rng.uniform(-3, 3)]) @ so3.exp(tilt)
    return rotation, distance * towards - rotation @ BOARD.points.mean(0)


def photograph(model, pose, rng, field=FIELD, noise=NOISE):
    """Give the board's corners as the true camera shows them: those in the circle, with noise."""
    rotation, translation = pose
    pixels, valid = model.project(BOARD.points @ rotation.T + translation)
    pixels = pixels + rng.normal(0, noise, pixels.shape)
    seen = valid & field.contains(pixels, 4)
    return BOARD.points[seen], pixels[seen]


def around(rng, count=10, theta=(0.0, 1.2), phi=(0.0, 2 * np.pi)):
    """Give poses of boards over a part of the field of view."""
    return [held(rng.uniform(*theta), rng.uniform(*phi), rng.uniform(9, 16), rng) for _ in range(count)]


def known_of(model, poses, rng, field=FIELD, noise=NOISE):
    """Calibrate on images of boards at some poses; give what is known, and the images."""
    shots = [photograph(model, pose, rng, field, noise) for pose in poses]
    shots = [shot for shot in shots if len(shot[0]) >= 12]
    return InformationPrior.of(Camera(model, SIZE), Observations.of(shots)), shots


@cache
def scene(name):
    """Give what is known of the lens, and the images: boards all around, in the middle alone, or on the right."""
    rng = np.random.default_rng(5)
    part = {"around": {}, "middle": {"theta": (0.0, 0.15)}, "right": {"theta": (0.3, 1.2), "phi": (-0.6, 0.6)}}[name]
    return known_of(LENS, around(rng, **part), rng)


def middle_of(view):
    return view.cam_from_board @ BOARD.points.mean(0)


def as_told(known, view):
    """Give the pose in which a person holds the board: its middle seen at that pixel, that far, tilted so."""
    middle = middle_of(view)
    pixel, _ = known.camera.project(middle)
    bearing, valid = LENS.unproject(pixel)
    assert valid
    turn = rotation_to(bearing) @ rotation_to(middle / np.linalg.norm(middle)).T
    rotation = turn @ view.cam_from_board.rotation
    return rotation, np.linalg.norm(middle) * bearing - rotation @ BOARD.points.mean(0)


def taken(shots, pose, seed):
    """Give the worst error after an image of the board at a pose was really taken and the camera refined with it."""
    after = InformationPrior.of(
        Camera(LENS, SIZE), Observations.of([*shots, photograph(LENS, pose, np.random.default_rng(seed))])
    )
    return worst(after, VisibleDirections.of(after, FIELD)).error


@pytest.mark.parametrize("name", ["around", "right"])
def test_the_promise_comes_true_and_beats_a_picture_taken_anywhere(name):
    known, shots = scene(name)
    (view,) = propose(known, BOARD, FIELD, 1).views
    achieved = np.mean([taken(shots, as_told(known, view), seed) for seed in range(3)])
    rng = np.random.default_rng(8)
    anywhere = np.mean([taken(shots, pose, 0) for pose in around(rng, 6, theta=(0.0, 1.7))])
    assert achieved == pytest.approx(view.after.error, rel=0.2)
    assert achieved < 0.5 * view.before.error
    assert achieved < 0.5 * anywhere


def test_a_set_in_the_middle_has_learned_the_rim_after_three_pictures_taken_as_told():
    """The first promise is a guess, for the camera guesses where the rim is; each image mends that."""
    known, shots = scene("middle")
    rng = np.random.default_rng(6)
    assert worst(known, VisibleDirections.of(known, FIELD)).error > UNKNOWN_PX
    anywhere = [*shots, *(photograph(LENS, pose, rng) for pose in around(rng, 3, theta=(0.0, 1.7)))]
    told = list(shots)
    for _ in range(3):
        (view,) = propose(known, BOARD, FIELD, 1).views
        told.append(photograph(LENS, as_told(known, view), rng))
        known = InformationPrior.of(Camera(LENS, SIZE), Observations.of(told))
    error = worst(known, VisibleDirections.of(known, FIELD)).error
    other = InformationPrior.of(Camera(LENS, SIZE), Observations.of(anywhere))
    assert error < 0.5
    assert error < 0.5 * worst(other, VisibleDirections.of(other, FIELD)).error


def test_a_set_in_the_middle_is_sent_to_the_rim():
    known, _ = scene("middle")
    (view,) = propose(known, BOARD, FIELD, 1).views
    board = angle_from_axis(view.cam_from_board @ BOARD.points)
    assert angle_from_axis(middle_of(view)) > known.reach
    assert board.max() > known.reach + np.radians(30)
    assert not view.before.calibrated


def test_a_set_on_one_side_is_sent_to_the_other():
    known, _ = scene("right")
    corners, _ = known.state.points(known.views)
    seen = np.arctan2(corners[:, 1], corners[:, 0])
    assert np.degrees(np.abs(seen[angle_from_axis(corners) > 0.6])).max() < 80
    (view,) = propose(known, BOARD, FIELD, 1).views
    x, y, _ = middle_of(view)
    assert np.degrees(np.abs(np.arctan2(y, x))) > 80


def test_each_next_picture_goes_on_from_the_one_before():
    known, _ = scene("around")
    proposal = propose(known, BOARD, FIELD, 3)
    assert len(proposal.views) == 3
    assert proposal.views[0].before == proposal.now
    for earlier, later in pairwise(proposal.views):
        assert later.before is earlier.after
        assert later.after.error < earlier.after.error
        assert later.after.mean < earlier.after.mean
    # The gain of the first is its own, whatever comes after it.
    assert propose(known, BOARD, FIELD, 1).views[0].after.error == proposal.views[0].after.error
    assert not proposal.enough


def test_what_a_board_tells_is_what_the_normal_equations_gain_by_it():
    known, _ = scene("around")
    rotation, translation = held(0.9, 2.0, 14.0, np.random.default_rng(3))
    told = BoardPlacements.of(known, BOARD, FIELD, rotation, translation)
    assert told.part[0] == 1.0
    points = BOARD.points
    pixels, _ = known.camera.model.project(points @ rotation.T + translation)
    views = Observations.of([(points, pixels)], extent=known.views.extent)
    state = State(known.camera.model, rotation[None], translation[None])
    plain = ResidualWeights(np.broadcast_to(np.eye(2), (len(points), 2, 2)), 1.0, np.inf)
    normal = Bundle(views, FreeParameters(known.freedom.directions), plain).linearize(state)
    gained = normal.reduced()[0] / known.variance
    scale = 1 / np.sqrt(np.diagonal(gained))
    np.testing.assert_allclose(scale[:, None] * told.information[0] * scale, scale[:, None] * gained * scale, atol=1e-6)


def test_errors_are_those_of_the_calibrations_own_uncertainty():
    known, _ = scene("around")
    visible = VisibleDirections.of(known, FIELD)
    # The covariance of the file, without what the halves of the images differ by beside.
    half = known.camera_basis @ known.half
    covariance = half @ half.T
    reach = float(visible.rings[visible.rings <= known.reach][-1])
    camera = replace(known.camera, covariance=covariance, theta_max=reach)
    expected = np.sqrt(np.trace(Uncertainty.of(camera).projection(visible.bearings), axis1=1, axis2=2))
    np.testing.assert_allclose(visible.errors(known, reach), expected, rtol=0.05)
    np.testing.assert_allclose(visible.errors_at(known, visible.bearings), visible.errors(known, known.reach))


def test_many_boards_at_once_are_as_good_as_one_by_one():
    known, _ = scene("middle")
    visible = VisibleDirections.of(known, FIELD)
    boards = BoardPlacements.all_over(known, BOARD, FIELD)
    assert 500 < len(boards.tilt) < 3000
    some = np.random.default_rng(0).choice(len(boards.tilt), 5, replace=False)
    reaches = np.maximum(boards.reach[some], known.reach)
    together = visible.errors_with(known, boards.information[some], reaches)
    for row, i in zip(together, some, strict=True):
        after = with_board(known, BOARD, FIELD, boards.rotations[i], boards.translations[i])
        np.testing.assert_allclose(row, visible.errors(after, after.reach), rtol=1e-4)


def test_boards_are_held_where_a_third_of_them_is_found():
    known, _ = scene("around")
    boards = BoardPlacements.all_over(known, BOARD, FIELD)
    for rotation, translation, part in zip(boards.rotations, boards.translations, boards.part, strict=True):
        pixels, valid = known.camera.project(BOARD.points @ rotation.T + translation)
        inside = valid & FIELD.contains(pixels, 4)
        assert inside.mean() >= part >= 1 / 3
    middles = boards.translations + boards.rotations @ BOARD.points.mean(0)
    # The printed side looks at the camera.
    assert (np.einsum("ki,ki->k", boards.rotations[:, :, 2], middles) > 0).all()
    assert np.degrees(np.unique(boards.tilt.round(6))) == pytest.approx([0, 30, 45])


def test_nothing_is_held_up_in_the_hole_of_a_mirror():
    field = replace(FIELD, inner=Ellipse(CENTRE, (120.0, 120.0)))
    rng = np.random.default_rng(1)
    known, _ = known_of(MIRROR, around(rng, 10, theta=(1.0, 1.6)), rng, field)
    proposal = propose(known, BOARD, field, 2)
    for view in proposal.views:
        pixel, valid = known.camera.project(middle_of(view))
        assert valid
        assert field.contains(pixel)
        assert view.after.error < view.before.error
    assert field.contains(proposal.visible.pixels).all()


def test_a_camera_that_is_sure_needs_no_more_pictures():
    rng = np.random.default_rng(2)
    known, _ = known_of(LENS, around(rng, 20, theta=(0.0, 1.7)), rng, noise=0.05)
    proposal = propose(known, BOARD, FIELD, 1)
    assert proposal.now.error < 0.2
    assert proposal.enough


def test_two_pictures_leave_the_rim_unknown_and_the_next_makes_more_of_it_known():
    rng = np.random.default_rng(4)
    known, _ = known_of(LENS, around(rng, 2, theta=(0.0, 0.1)), rng)
    proposal = propose(known, BOARD, FIELD, 3)
    assert proposal.now.error > UNKNOWN_PX
    means = [proposal.now.mean, *(view.after.mean for view in proposal.views)]
    assert all(later < earlier for earlier, later in pairwise(means))
    assert np.isfinite(means).all()
    assert proposal.views[-1].after.error < UNKNOWN_PX


def test_a_bent_board_and_parameters_that_stood_still_are_taken_as_calibrated():
    model = model_class("kannala_brandt").example()
    still = np.zeros((model.params.size, model.params.size))
    moving = [model.param_names.index(name) for name in ("fx", "fy", "cx", "k1")]
    still[moving, moving] = 1.0
    freedom = estimated(Camera(model, SIZE, covariance=still, calibration={"board_warp": [0.0, 0.0]}))
    assert freedom.warp
    assert np.flatnonzero(freedom.directions.any(1)).tolist() == sorted(moving)
    square = still.copy()
    square[moving[0], moving[1]] = square[moving[1], moving[0]] = 1.0
    assert estimated(Camera(model, SIZE, covariance=square)).directions.shape[1] == 3
    assert estimated(Camera(model, SIZE)).directions.shape[1] == FreeParameters.of(model).directions.shape[1]


def test_a_camera_that_is_not_that_of_the_pictures_is_refused():
    _, shots = scene("around")
    views = Observations.of(shots)
    with pytest.raises(ValueError, match="no image shows the board"):
        InformationPrior.of(Camera(LENS, SIZE), Observations.of([]))
    pinhole = model_class("pinhole").from_dict({"fx": 300, "fy": 300, "cx": 480, "cy": 480, "skew": 0})
    with pytest.raises(ValueError, match="does not explain these images: half of the corners are more than"):
        InformationPrior.of(Camera(pinhole, SIZE), views)
