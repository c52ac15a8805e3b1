"""Exact samples of the minimal solvers: bearings over the whole sphere and the motion between them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnisight import twoview
from omnisight.geometry.rotation import exp


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_rotation(rng):
    return exp(unit(rng.normal(size=3)) * rng.uniform(0, np.pi))


def bearing_pairs(rng, count, rotation, translation):
    """Return bearings of points all around camera a, and those of the same points in camera b."""
    a = unit(rng.normal(size=(count, 3)))
    points = a * rng.uniform(1, 8, (count, 1))
    return a, unit(points @ rotation.T + translation)


def general_motion(rng, count=5):
    rotation, translation = random_rotation(rng), unit(rng.normal(size=3))
    return *bearing_pairs(rng, count, rotation, translation), np.column_stack([rotation, translation])


def eight_pairs(rng):
    return general_motion(rng, 8)


def bearings_of_plane(rng):
    """Return bearings of four points of a plane at the distance 1 in both cameras, the pose and the normal."""
    rotation, translation, normal = random_rotation(rng), rng.normal(size=3), unit(rng.normal(size=3))
    a = unit(rng.normal(size=(4, 3)))
    a *= np.sign(a @ normal)[:, None]
    points = a / (a @ normal)[:, None]
    return a, unit(points @ rotation.T + translation), np.column_stack([rotation, translation]), normal


def plane(rng):
    return bearings_of_plane(rng)[:3]


def poses_of_plane(a, b):
    homographies = twoview.four_point_homography(a, b)
    return twoview.poses_from_homography(homographies[0], a)[0] if len(homographies) else np.empty((0, 3, 4))


def about_vertical(rng):
    return exp([0, rng.uniform(-np.pi, np.pi), 0])


def upright_motion(rng):
    rotation, translation = about_vertical(rng), unit(rng.normal(size=3))
    return *bearing_pairs(rng, 3, rotation, translation), np.column_stack([rotation, translation])


def planar_motion(rng):
    rotation, translation = about_vertical(rng), unit(rng.normal(size=3) * (1, 0, 1))
    return *bearing_pairs(rng, 2, rotation, translation), np.column_stack([rotation, translation])


def circular_motion(rng):
    turn, step = rng.uniform(-np.pi, np.pi), rng.choice([-1.0, 1.0])
    rotation = exp([0, turn, 0]).T
    translation = -rotation @ (step * np.array([np.sin(turn / 2), 0, np.cos(turn / 2)]))
    return *bearing_pairs(rng, 1, rotation, translation), np.column_stack([rotation, translation])


def pure_rotation(rng):
    rotation = random_rotation(rng)
    return *bearing_pairs(rng, 2, rotation, np.zeros(3)), np.column_stack([rotation, np.zeros(3)])


def absolute_pose(rng):
    rotation, translation = random_rotation(rng), 3 * rng.normal(size=3)
    bearings = unit(rng.normal(size=(3, 3)))
    points = (bearings * rng.uniform(1, 8, (3, 1)) - translation) @ rotation
    return points, bearings, np.column_stack([rotation, translation])


def upright_absolute_pose(rng):
    rotation, translation = about_vertical(rng), 3 * rng.normal(size=3)
    bearings = unit(rng.normal(size=(2, 3)))
    points = (bearings * rng.uniform(1, 8, (2, 1)) - translation) @ rotation
    return points, bearings, np.column_stack([rotation, translation])


def rig_pose(rng):
    """Return points, rays (origin and bearing in a row) of a rig, and the pose of the rig."""
    rotation, translation = random_rotation(rng), 3 * rng.normal(size=3)
    origins, bearings = rng.normal(size=(3, 3)), unit(rng.normal(size=(3, 3)))
    points = (origins + bearings * rng.uniform(1, 8, (3, 1)) - translation) @ rotation
    return points, np.column_stack([origins, bearings]), np.column_stack([rotation, translation])


def rig_motion(rng):
    """Return seventeen pairs of rays (origin and bearing in a row) of a rig, and its motion."""
    rotation, translation = random_rotation(rng), rng.normal(size=3)
    origins_a, origins_b = rng.normal(size=(2, 17, 3))
    a = unit(rng.normal(size=(17, 3)))
    b = unit((origins_a + a * rng.uniform(1, 8, (17, 1))) @ rotation.T + translation - origins_b)
    pose = np.column_stack([rotation, translation])
    return np.column_stack([origins_a, a]), np.column_stack([origins_b, b]), pose


def motions_of_rig(a, b):
    return twoview.seventeen_point(a[:, :3], a[:, 3:], b[:, :3], b[:, 3:])


def poses_of_rig(points, rays):
    return twoview.gp3p(points, rays[:, :3], rays[:, 3:])


def chords_of_rig(pose, points, rays):
    return np.linalg.norm(unit(points @ pose[:, :3].T + pose[:, 3] - rays[:, :3]) - rays[:, 3:], axis=1)


def gaps(pose, a, b):
    """Return how far the rays of each pair are apart, inf if a distance along a bearing is not positive."""
    zero = np.zeros_like(a)
    return gaps_of_rig(pose, np.column_stack([zero, a]), np.column_stack([zero, b]))


def gaps_of_rig(pose, a, b):
    gaps = []
    offsets = a[:, :3] @ pose[:, :3].T + pose[:, 3] - b[:, :3]
    for p, q, offset in zip(a[:, 3:] @ pose[:, :3].T, b[:, 3:], offsets, strict=True):
        distances, *_ = np.linalg.lstsq(np.column_stack([p, -q]), -offset, rcond=None)
        gap = np.linalg.norm(distances[0] * p + offset - distances[1] * q)
        gaps.append(gap if (distances > 0).all() else np.inf)
    return np.array(gaps)


def chords(pose, points, bearings):
    """Return the distances between bearings and the directions of posed points: 2 if they are opposite."""
    return np.linalg.norm(unit(points @ pose[:, :3].T + pose[:, 3]) - bearings, axis=1)


@dataclass(frozen=True)
class Subject:
    """A solver with its exact samples.

    `sample` draws the inputs and the true pose; `residuals` are zero for the correspondences that a pose explains with
    positive distances.
    """

    solve: Callable[..., Any]
    sample: Callable[[np.random.Generator], Any]
    max_solutions: int
    residuals: Callable[..., Any] = gaps


SUBJECTS = {
    "five_point": Subject(twoview.five_point, general_motion, 10),
    "eight_point": Subject(twoview.eight_point, eight_pairs, 1),
    "four_point_homography": Subject(poses_of_plane, plane, 2),
    "upright_three_point": Subject(twoview.upright_three_point, upright_motion, 4),
    "planar_two_point": Subject(twoview.planar_two_point, planar_motion, 2),
    "circular_one_point": Subject(twoview.circular_one_point, circular_motion, 1),
    "two_point_rotation": Subject(twoview.two_point_rotation, pure_rotation, 1, chords),
    "upright_p2p": Subject(twoview.upright_p2p, upright_absolute_pose, 2, chords),
    "p3p": Subject(twoview.p3p, absolute_pose, 4, chords),
    "gp3p": Subject(poses_of_rig, rig_pose, 8, chords_of_rig),
    "seventeen_point": Subject(motions_of_rig, rig_motion, 1, gaps_of_rig),
}
