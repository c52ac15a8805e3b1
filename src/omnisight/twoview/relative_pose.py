"""Relative pose of two cameras from matched bearings, some of which are wrong."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import RobustEstimate, estimate_robustly
from omnisight.twoview.bearing_pairs import BearingPairs, BearingPairsProblem, isotropic_variance
from omnisight.twoview.epipolar import epipolar_residuals, is_behind
from omnisight.twoview.motion_model import MotionModel, select_motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The estimated relative pose of two cameras; false if none was found.

    Attributes
    ----------
    b_from_a : Pose or None
        x_b = R x_a + t, with t of unit length, or zero if `motion` is "rotation only".
    covariance : (6, 6) array
        Covariance of a step (w, v) of `Pose.moved`, square radians; zero along the translation.
    inliers : (N,) array of bool
        Pairs that are more probably inliers than outliers.
    motion : MotionModel
        The model of the motion that explains the pairs best; "no overlap" if no pose was found.
    sigma_deg : float
        Standard deviation of the bearings, root mean square over both cameras: the given or the estimated one.
    score : float
        Sum of the squared residuals of the search over their variances, truncated at 9 each.
    iterations : int
        Number of samples drawn.
    reason : str
        Why no pose was found; empty otherwise.
    """

    b_from_a: Pose | None
    covariance: Array = field(repr=False)
    inliers: NDArray[np.bool_] = field(repr=False)
    motion: MotionModel
    sigma_deg: float
    score: float
    iterations: int
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether a pose was found."""
        return self.b_from_a is not None


def relative_pose(
    bearings_a: ArrayLike,
    bearings_b: ArrayLike,
    covariance_a: ArrayLike | None = None,
    covariance_b: ArrayLike | None = None,
    sigma_deg: ArrayLike | None = None,
    options: RansacOptions = RansacOptions(),
) -> RelativePose:
    """Estimate the relative pose of two cameras from matched bearings.

    LO-RANSAC with Nister's five-point solver finds the inliers; the pose is then the maximum-likelihood estimate under
    a mixture of Gaussian noise and outliers. Bearings may have any direction, also behind the camera. A pair is an
    inlier only if its point has positive distances along both bearings. A rotation without translation, a dominant
    plane, planar motion and insufficient parallax are recognized, see `MotionModel`.

    Parameters
    ----------
    bearings_a, bearings_b
        (N, 3) directions of the same points in both camera frames.
    covariance_a, covariance_b
        (N, 3, 3) covariances of the bearings, square radians.
    sigma_deg
        Standard deviation of the bearings, degrees, one or (N,), in place of covariances. Without both, the noise is
        assumed to be isotropic and equal, and is estimated.
    options
        Options of the search, with the seed.

    Raises
    ------
    ValueError
        If arrays have the wrong shape or do not hold directions and covariances.
    """
    pairs = BearingPairs.of(bearings_a, bearings_b, covariance_a, covariance_b, sigma_deg)
    return estimate_relative_pose(pairs, options)


def estimate_relative_pose(pairs: BearingPairs, options: RansacOptions = RansacOptions()) -> RelativePose:
    """Estimate the relative pose of pairs of bearings; see `relative_pose`."""
    found = estimate_robustly(RelativePoseProblem(pairs), options)
    covariance = np.full((6, 6), np.nan)
    if found.state is not None:
        pairs = replace(pairs.scaled(found.scale), is_noise_known=True)
        basis = tangent_basis(found.state)
        covariance = basis @ found.covariance @ basis.T
    motion, rotation = select_motion(pairs, found, covariance, options)
    if rotation is not None and rotation.state is not None:
        return _rotation_only(pairs, rotation, motion)
    sigma = _sigma_deg(pairs)
    return RelativePose(
        found.state, covariance, found.inliers, motion, sigma, found.score, found.iterations, found.reason
    )


def _rotation_only(pairs: BearingPairs, rotation: RobustEstimate[Array], motion: MotionModel) -> RelativePose:
    """Return the relative pose of cameras in one place."""
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = rotation.covariance
    sigma = rotation.scale * _sigma_deg(pairs)
    pose = Pose(np.asarray(rotation.state, float))
    return RelativePose(pose, covariance, rotation.inliers, motion, sigma, rotation.score, rotation.iterations)


def _sigma_deg(pairs: BearingPairs) -> float:
    return float(np.degrees(np.sqrt(pairs.variance.mean() / 2))) if len(pairs) else float("nan")


@dataclass(frozen=True, eq=False)
class RelativePoseProblem(BearingPairsProblem):
    """The relative pose of two cameras as a problem of `estimate_robustly`; a step is that of `tangent_basis`."""

    sample_size = 5
    max_solutions = 10
    dimension = 1

    def compiled(self, order: NDArray[np.intp]) -> Any:
        """Return the problem with isotropic variances."""
        from omnisight.twoview._relative_pose_kernel import CompiledRelativePose

        pairs = self.pairs
        variances = isotropic_variance(pairs.covariance_a), isotropic_variance(pairs.covariance_b)
        return CompiledRelativePose(*(np.ascontiguousarray(rows[order]) for rows in (pairs.a, pairs.b, *variances)))

    def state(self, model: Array) -> Pose:
        """Return [R | t] as a pose."""
        return Pose(model[:, :3], model[:, 3])

    def linearize(self, state: Pose) -> tuple[Array, Array]:
        """Return the epipolar residuals (N, 1) and Jacobians (N, 1, 5)."""
        residuals, jacobian = epipolar_residuals(self.pairs, state)
        residuals[is_behind(self.pairs, state)] = np.nan
        return residuals[:, None], (jacobian @ tangent_basis(state))[:, None]

    def feature(self, state: Pose) -> Array:
        """Return the squared chords (N,) of the parallax: unrelated bearings have a large one."""
        return ((self.pairs.a @ state.rotation.T - self.pairs.b) ** 2).sum(1)

    def retract(self, state: Pose, step: Array) -> Pose:
        """Move a pose, and keep its translation of unit length."""
        moved = state.moved(tangent_basis(state) @ step)
        return Pose(moved.rotation, moved.translation / np.linalg.norm(moved.translation))


def tangent_basis(pose: Pose) -> Array:
    """Return the steps (6, 5) of a pose that keep the length of its translation: rotations and two translations."""
    t = pose.translation
    first = np.cross(t, np.eye(3)[np.abs(t).argmin()])
    first /= np.linalg.norm(first)
    basis = np.zeros((6, 5))
    basis[:3, :3] = np.eye(3)
    basis[3:, 3:] = np.column_stack([first, np.cross(t, first)])
    return basis
