"""Relative pose from pairs of bearings of a dominant plane.

The homography of a plane is known from its points more precisely than an epipolar geometry, because unrelated pairs
rarely agree with it in two dimensions. It belongs to two motions, between which the points that are not on the plane,
or not in front of both cameras, decide.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.block_jackknife import variance_ratio
from omnisight.optim.false_alarms import chance_probability
from omnisight.optim.ransac import permuted
from omnisight.optim.refinement import THRESHOLDS, Refinement, refine
from omnisight.optim.robust_estimation import MAX_FALSE_ALARMS
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]

# A motion is possible if it has this share of the points of the plane in front of both cameras: those seen from near
# the plane may seem to be behind.
MIN_SHARE_IN_FRONT = 0.95
# Sine of the angle between the translation and the normal of the plane below which the angle is rounding.
MIN_SINE = 1e-12
# Probability of a motion above which the other one is excluded.
MIN_PROBABILITY = 0.999
# Coordinate axes, and their cross-product matrices: the derivatives of a rotation by its rotation vector, at zero.
AXES = np.eye(3)
GENERATORS = so3.hat(AXES)


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """A motion that explains a plane and the other points.

    Attributes
    ----------
    b_from_a
        With a translation of unit length.
    covariance
        (5, 5) covariance of the steps of `tangent_basis`.
    inliers
        (N,), whether each pair is more probably an inlier than an outlier.
    evidence
        Logarithm of the likelihood of the points that are not on the plane, over that of outliers.
    """

    b_from_a: Pose
    covariance: Array
    inliers: NDArray[np.bool_]
    evidence: float


def plane_motions(pairs: BearingPairs, homography: Array, order: NDArray[np.intp]) -> list[tuple[float, PlaneMotion]]:
    """Return the possible motions with their probabilities, the more probable one first.

    Parameters
    ----------
    pairs
        With known noise.
    homography
        (3, 4), a model of `HomographyProblem`, close to that of the plane.
    order
        (N,) random order of the pairs, in which they are compared with unrelated ones.
    """
    from omnisight.twoview._alignment_problems_kernel import HomographyProblem

    plane = refine(permuted(HomographyProblem.of(pairs), order), homography)
    is_on_plane = np.empty_like(plane.is_inlier)
    is_on_plane[order] = plane.is_inlier
    others = pairs[order[~plane.is_inlier]]
    on_plane = pairs[is_on_plane]
    ratio = variance_ratio(HomographyProblem.of(on_plane), plane.model, on_plane.a)
    plane = plane._replace(covariance=ratio * plane.covariance)
    motions = [
        _with_other_points(others, order, is_on_plane, *motion) for motion in _decomposed(plane, pairs.a[is_on_plane])
    ]
    motions.sort(key=lambda motion: -motion.evidence)
    weights = np.exp([motion.evidence - motions[0].evidence for motion in motions])
    probabilities = weights / weights.sum()
    if len(motions) and probabilities[0] > MIN_PROBABILITY:
        return [(1.0, motions[0])]
    return list(zip(probabilities.tolist(), motions, strict=True))


def tangent_basis(pose: Pose) -> Array:
    """Return the steps (6, 5) of a pose that keep the length of its translation: rotations and two translations.

    They are those of `_relative_pose_kernel`.
    """
    from omnisight.twoview._small_vectors_kernel import perpendiculars

    basis = np.zeros((6, 5))
    basis[:3, :3] = np.eye(3)
    basis[3:, 3], basis[3:, 4] = perpendiculars.py_func(pose.translation)
    return basis


def _decomposed(plane: Refinement, bearings: Array) -> Iterator[tuple[Pose, Array]]:
    """Yield the motions of a homography with the points (N, 3) in front of both cameras, and covariances (5, 5)."""
    from omnisight.twoview.minimal_solvers import poses_from_homography

    model = plane.model[:, :3]
    scale = 1.0 / np.linalg.svd(model, compute_uv=False)[1]
    for motion, normal in zip(*poses_from_homography(scale * model, np.empty((0, 3))), strict=True):
        in_front = int((bearings @ normal > 0).sum())
        share = max(in_front, len(bearings) - in_front) / max(len(bearings), 1)
        if share < MIN_SHARE_IN_FRONT or not motion[:, 3].any():
            continue
        sign = 1.0 if 2 * in_front > len(bearings) else -1.0
        pose = Pose(motion[:, :3], sign * motion[:, 3] / np.linalg.norm(motion[:, 3]))
        # For a motion along the normal, both motions of the homography are the same, and the derivatives are singular.
        if np.linalg.norm(pose.translation - (pose.translation @ normal) * normal) < MIN_SINE:
            continue
        by_motion = _homography_by_motion(motion[:, :3], sign * motion[:, 3], sign * normal)
        columns = np.column_stack([by_motion, model.ravel()])
        by_element = np.linalg.inv(columns)[:6, np.arange(9) != np.abs(model).argmax()]
        by_element = scale * tangent_basis(pose).T @ by_element
        yield pose, by_element @ plane.covariance @ by_element.T


def _homography_by_motion(rotation: Array, translation: Array, normal: Array) -> Array:
    """Return the derivatives (9, 8) of the homography R + t n^T of a plane by motion and normal.

    A step (w, |t| v) of the motion and a change u of the normal change it by w x R + |t| v n^T + t u^T.
    """
    from omnisight.twoview._small_vectors_kernel import perpendiculars

    tangents = np.array(perpendiculars.py_func(normal))
    turns = GENERATORS @ rotation
    shifts = float(np.linalg.norm(translation)) * AXES[:, :, None] * normal
    tilts = translation[:, None] * tangents[:, None, :]
    return np.concatenate([turns, shifts, tilts]).reshape(8, 9).T


def _with_other_points(
    others: BearingPairs, order: NDArray[np.intp], is_on_plane: NDArray[np.bool_], pose: Pose, covariance: Array
) -> PlaneMotion:
    """Return the motion of a plane, refined by the other points if more of them agree with it than do by chance.

    The other points have the order in which they stand among all of them.
    """
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    problem = RelativePoseProblem.of(others)
    if len(others) < 2 or not _is_supported(problem, pose.matrix):
        return PlaneMotion(pose, covariance, is_on_plane, 0.0)
    fit = refine(problem, pose.matrix, prior=np.asarray(np.linalg.inv(covariance), float))
    inliers = is_on_plane.copy()
    inliers[order[~is_on_plane[order]]] = fit.is_inlier
    return PlaneMotion(Pose.of_matrix(fit.model), fit.covariance, inliers, fit.evidence)


def _is_supported(problem: Any, model: Array) -> bool:
    """Return whether significantly more pairs agree with a motion than unrelated ones do."""
    from omnisight.optim._robust_problem_kernel import squared_errors

    agreeing = int((squared_errors(problem, model) <= THRESHOLDS[1]).sum())
    chance = chance_probability(problem, model, THRESHOLDS[1])
    return bool(bdtrc(agreeing - 1, len(problem[0]), chance) <= MAX_FALSE_ALARMS)
