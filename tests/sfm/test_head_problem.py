"""Residuals and priors of the calibration of a head."""

import dataclasses

import numpy as np
import pytest

from omnisight import Camera
from omnisight.geometry import rotation as so3
from omnisight.images.ellipse import Ellipse
from omnisight.images.image_field import ImageField
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.pipeline.stitching.stitch_inputs import _common_circle
from omnisight.sfm.head_calibration import _solve
from omnisight.sfm.head_matches import OverlapMatches
from omnisight.sfm.head_problem import HeadMotion, HeadProblem

SIZE, CENTRE = 1300, 649.5
BACK_FROM_FRONT = so3.exp([0.0, np.pi, 0.0])
LENS = Camera(KannalaBrandt(414.0, 414.0, CENTRE, CENTRE, -0.02, -0.005, 0.0, 0.0), (SIZE, SIZE))


def test_matches_outside_the_domain_of_a_lens_are_not_without_residual():
    rng, count = np.random.default_rng(0), 50
    theta, phi = np.radians(rng.uniform(81, 99, count)), rng.uniform(0, 2 * np.pi, count)
    front = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    first, other = (LENS.project(x)[0] + 0.5 for x in (front, front @ BACK_FROM_FRONT.T))
    frame = np.zeros(count, np.intp)
    inside = HeadProblem((LENS, LENS), (4.0, 4.0), BACK_FROM_FRONT, OverlapMatches(first, other, frame), [], 0.01, 3e-3)
    # Both lenses: the zero vectors of invalid bearings agree with any rotation.
    beyond = OverlapMatches(first + 5000.0, other + 5000.0, frame)
    outside, x = dataclasses.replace(inside, overlap=beyond), np.zeros(inside.size)
    assert np.abs(outside.residuals(x)[: 3 * count]).min() > np.abs(inside.residuals(x)[: 3 * count]).max()
    assert np.isinf(outside.distances(x)).all()
    assert inside.distances(x).max() < 0.01


def test_a_circle_that_glare_enlarges_is_replaced_by_one_of_uncertain_centre():
    own = ImageField((SIZE, SIZE), Ellipse((655.0, 640.0), (600.0, 600.0), 0.0))
    glare = ImageField((SIZE, SIZE), Ellipse((580.0, 640.0), (680.0, 650.0), 0.0))
    first, second = _common_circle([own, glare])
    assert first.is_own
    assert first.field == own
    assert not second.is_own
    assert second.circle.radius == pytest.approx(600.0)
    assert second.circle.centre == (CENTRE, CENTRE)
    assert second.center_sigma == pytest.approx(3 * first.center_sigma)


@pytest.mark.parametrize("near_share", [0.0, 0.9])
def test_the_uncertainty_of_lenses_of_a_head_at_rest_contains_the_effect_of_parallax(near_share):
    true = Camera(KannalaBrandt(505.0, 505.0, CENTRE, CENTRE, -0.094, 0.0034, 0.0, 0.0), (SIZE, SIZE))
    rng, count = np.random.default_rng(1), 100
    theta, phi = np.radians(rng.uniform(80, 100, count)), rng.uniform(0, 2 * np.pi, count)
    front = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    # The ground, below, is 1 m away, and the lenses are 5 cm apart.
    near = (front[:, 1] > 0.3) & (rng.random(count) < near_share)
    back = (front * np.where(near, 1.0, 1e3)[:, None] + [0, 0, 0.05]) @ BACK_FROM_FRONT.T
    first, other = (true.project(x)[0] + rng.normal(scale=0.3, size=(count, 2)) for x in (front, back))
    guess = Camera(KannalaBrandt(420.0, 420.0, CENTRE, CENTRE, -0.02, 0.0, 0.0, 0.0), (SIZE, SIZE))
    overlap = OverlapMatches(first, other, np.zeros(count, np.intp))
    found = _solve(HeadProblem((guess, guess), (4.0, 4.0), BACK_FROM_FRONT, overlap, [], 0.01, 3e-3), 1)
    error = np.log(found.cameras[0].model.fx / true.model.fx)
    assert 0.0 < abs(error) < 3 * np.sqrt(found.covariance[0, 0])


def moving_head(seed, apart):
    """Return the error of the focal length of a head that moves among near points, in standard deviations."""
    rng, frames = np.random.default_rng(seed), 4
    true = Camera(KannalaBrandt(414.0, 414.0, CENTRE, CENTRE, -0.035, 0.0, 0.0, 0.0), (SIZE, SIZE))
    to_lens = (np.eye(3), np.zeros(3)), (BACK_FROM_FRONT, BACK_FROM_FRONT @ [0, 0, apart])
    directions = rng.normal(size=(3000, 3))
    world = directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(1.0, 3.0, (3000, 1))
    poses = [(so3.exp(rng.normal(0, 0.2, 3)), rng.normal(0, 0.3, 3)) for _ in range(frames)]

    def seen(pose, lens, points):
        """Return pixels of points in a lens, with noise, and which of them it sees."""
        turn, offset = to_lens[lens]
        local = (points @ pose[0].T + pose[1]) @ turn.T + offset
        angle = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
        return true.project(local)[0] + rng.normal(0, 0.3, (len(points), 2)), angle < np.radians(98)

    pairs, motions = [], []
    for k, pose in enumerate(poses):
        (a, in_a), (b, in_b) = (seen(pose, lens, world[:600]) for lens in (0, 1))
        pairs.append((a[in_a & in_b], b[in_a & in_b], np.full((in_a & in_b).sum(), k)))
        if k:
            turn = pose[0] @ poses[k - 1][0].T
            move, matches = pose[1] - turn @ poses[k - 1][1], []
            for lens in (0, 1):
                (before, first), (after, second) = (seen(poses[i], lens, world[600:1200]) for i in (k - 1, k))
                matches.append((before[first & second], after[first & second]))
            length = np.linalg.norm(move)
            motions.append(HeadMotion(turn, move / length, 2.0 / length, matches))
    first, other, frame = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    guess = Camera(KannalaBrandt(420.0, 420.0, CENTRE, CENTRE, -0.02, 0.0, 0.0, 0.0), (SIZE, SIZE))
    overlap = OverlapMatches(first, other, frame.astype(np.intp))
    problem = HeadProblem((guess, guess), (4.0, 4.0), BACK_FROM_FRONT, overlap, motions, 0.01, 3e-3)
    found = _solve(problem, frames)
    return np.log(found.cameras[0].model.fx / true.model.fx) / np.sqrt(found.covariance[0, 0])


def test_the_uncertainty_of_lenses_of_a_moving_head_contains_that_they_are_apart():
    errors = [moving_head(seed, 0.04) for seed in range(4)]
    assert np.sqrt(np.mean(np.square(errors))) < 1.5
    assert np.abs(errors).max() < 3
