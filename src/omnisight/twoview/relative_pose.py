"""Relative pose of two cameras from matched bearings, some of which are wrong."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry import sphere
from omnisight.geometry.pose import Pose
from omnisight.optim.block_jackknife import variance_ratio
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.refinement import THRESHOLDS
from omnisight.optim.robust_estimation import RobustEstimate, estimate_robustly
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.motion_model import MotionModel, pose_motion, select_motion, unknown_direction
from omnisight.twoview.plane_motion import PlaneMotion, plane_motions, tangent_basis

Array = NDArray[np.float64]

# Largest residual of an inlier of a known pose: it includes the errors of the calibration.
MAX_RESIDUAL_SIGMA = 5.0


@dataclass(frozen=True, eq=False)
class RelativePose(Displayed):
    """The estimated relative pose of two cameras; false if none was found.

    Attributes
    ----------
    b_from_a : Pose or None
        x_b = R x_a + t, with t of unit length, or zero if `motion` is "rotation only".
    covariance : (6, 6) array
        Covariance of a step (w, v) of `Pose.moved`, square radians; zero along the translation. It includes the
        correlation of neighbouring residuals, see `variance_ratio`, unless `motion` is "rotation only".
    inliers : (N,) array of bool
        Pairs that are more probably inliers than outliers.
    motion : MotionModel
        The model of the motion that explains the pairs best; "no overlap" or "ambiguous" if no pose was found.
    sigma_deg : float
        Standard deviation of the bearings, root mean square over both cameras: the given or the estimated one.
    score : float
        Sum of the squared residuals of the search over their variances, truncated at 9 each.
    iterations : int
        Number of samples drawn.
    reason : str
        Why no pose was found; empty otherwise.
    alternative : Pose or None
        Second pose that explains the pairs, if most points are on a plane: a plane has two motions. `covariance` is
        then that of both, weighted by their probabilities, about `b_from_a`.
    probability : float
        Probability of `b_from_a`, if there is an alternative.
    """

    b_from_a: Pose | None
    covariance: Array = field(repr=False)
    inliers: NDArray[np.bool_] = field(repr=False)
    motion: MotionModel
    sigma_deg: float
    score: float
    iterations: int
    reason: str = ""
    alternative: Pose | None = None
    probability: float = 1.0

    def __bool__(self) -> bool:
        """Return whether a pose was found."""
        return self.b_from_a is not None


def relative_pose(
    bearings_a: ArrayLike,
    bearings_b: ArrayLike,
    covariance_a: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
    sigma_deg: ArrayLike | None = None,
    seed: int = 0,
) -> RelativePose:
    """Estimate the relative pose of two cameras from matched bearings.

    LO-RANSAC with Nister's five-point solver finds the inliers; the pose is then the maximum-likelihood estimate under
    a mixture of Gaussian noise and outliers. Bearings may have any direction, also behind the camera. A pair is an
    inlier only if its point has positive distances along both bearings. A rotation without translation, a dominant
    plane, planar motion and insufficient parallax are recognized, see `MotionModel`. If most points are on a plane, the
    pose is that of its homography and of the other points; without these, there may be two, see `alternative`. No pose
    is returned if another one has nearly as many inliers, as with matches of repeated structures.

    Parameters
    ----------
    bearings_a, bearings_b
        (N, 3) directions of the same points in both camera frames.
    covariance_a, covariance_b
        (N, 3, 3) covariances of the bearings, square radians.
    sigma_deg
        Standard deviation of the bearings, degrees, one or (N,), in place of covariances. Without both, the noise is
        assumed to be isotropic and equal, and is estimated.
    seed
        Seed of the search: the same input and seed give the same result.

    Raises
    ------
    ValueError
        If arrays have the wrong shape or do not hold directions and covariances.
    """
    pairs = BearingPairs.of(bearings_a, bearings_b, covariance_a, covariance_b, sigma_deg)
    return estimate_relative_pose(pairs, RansacOptions(seed=seed))


def estimate_relative_pose(pairs: BearingPairs, options: RansacOptions = RansacOptions()) -> RelativePose:
    """Estimate the relative pose of pairs of bearings; see `relative_pose`."""
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    found = estimate_robustly(
        lambda scale: RelativePoseProblem.of(pairs.scaled(scale)), is_scale_known=pairs.is_noise_known, options=options
    )
    if found.model is not None and not pairs.is_noise_known:
        pairs = replace(pairs.scaled(found.scale), is_noise_known=True)
    inliers = pairs[found.order[found.inliers[found.order]]]
    best = select_motion(pairs, inliers, found, options)
    if best.rotation is not None and best.rotation.model is not None:
        return _rotation_only(pairs, best.rotation.model, best.rotation, best.motion)
    if best.homography is not None and (motions := plane_motions(pairs, best.homography, found.order)):
        return _on_plane(pairs, motions, best.motion, found)
    pose, covariance, motion, sigma = None, np.full((6, 6), np.nan), best.motion, _sigma_deg(pairs)
    if found.model is not None:
        pose = Pose.of_matrix(found.model)
        basis = tangent_basis(pose)
        ratio = variance_ratio(RelativePoseProblem.of(inliers), found.model, inliers.a)
        covariance = ratio * (basis @ found.covariance @ basis.T)
        motion = pose_motion(found.model, covariance) if motion.name == "general" else motion
    if motion.name in ("general", "planar motion") and (reason := found.ambiguity):
        pose, motion, found = None, MotionModel("ambiguous", reason), replace(found, reason=reason)
    return RelativePose(pose, covariance, found.inliers, motion, sigma, found.score, found.iterations, found.reason)


def known_relative_pose(pairs: BearingPairs, b_from_a: Pose) -> RelativePose:
    """Return a relative pose that is known, such as that of two cameras of a rig, with the pairs that agree with it."""
    from omnisight.optim._robust_problem_kernel import squared_residuals
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    squares = squared_residuals(RelativePoseProblem.of(pairs), b_from_a.matrix)
    score = float(np.minimum(squares, THRESHOLDS[1]).sum())
    motion = MotionModel("general", "known")
    inliers = squares <= MAX_RESIDUAL_SIGMA**2
    return RelativePose(b_from_a, np.zeros((6, 6)), inliers, motion, _sigma_deg(pairs), score, 0)


def _rotation_only(pairs: BearingPairs, model: Array, rotation: RobustEstimate, motion: MotionModel) -> RelativePose:
    """Return the relative pose of cameras in one place."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = rotation.covariance
    sigma = rotation.scale * _sigma_deg(pairs)
    pose = Pose(model[:, :3].copy())
    return RelativePose(pose, covariance, rotation.inliers, motion, sigma, rotation.score, rotation.iterations)


def _on_plane(
    pairs: BearingPairs, motions: list[tuple[float, PlaneMotion]], motion: MotionModel, general: RobustEstimate
) -> RelativePose:
    """Return the more probable motion of a plane, with the covariance of all."""
    probability, best = motions[0]
    covariance, along = np.zeros((6, 6)), tangent_basis(best.b_from_a)
    for weight, other in motions:
        covariance += weight * (along @ other.covariance @ along.T)
    for weight, other in motions[1:]:
        turn = so3.log(other.b_from_a.rotation @ best.b_from_a.rotation.T)
        shift = sphere.tangent(best.b_from_a.translation, other.b_from_a.translation)
        # Between distant motions, no linear relation holds between both parts of a step, so they are not correlated.
        covariance[:3, :3] += weight * np.outer(turn, turn)
        covariance[3:, 3:] += weight * np.outer(shift, shift)
    alternative = motions[1][1].b_from_a if len(motions) > 1 else None
    if vague := unknown_direction(along @ best.covariance @ along.T):
        motion = vague
    elif alternative is not None:
        figure = f"{motion.figure}, which has two motions, {probability:.0%} and {1 - probability:.0%} probable"
        motion = replace(motion, figure=figure)
    return RelativePose(
        b_from_a=best.b_from_a,
        covariance=covariance,
        inliers=best.inliers,
        motion=motion,
        sigma_deg=_sigma_deg(pairs),
        score=general.score,
        iterations=general.iterations,
        alternative=alternative,
        probability=probability,
    )


def _sigma_deg(pairs: BearingPairs) -> float:
    return float(np.degrees(np.sqrt(pairs.variance.mean() / 2))) if len(pairs) else float("nan")
