"""The pose of a frame from rays of known points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.refinement import refine
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Rays that must agree with a pose. Three determine it; by chance further ones agree with a probability below a tenth.
MIN_INLIERS = 12
# Share of the rays that must agree with the pose near the prediction; otherwise it is searched anew.
MIN_INLIER_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class FramePose:
    """The pose of a frame; false if it was not found.

    Attributes
    ----------
    rig_from_world
        The pose, None if it was not found.
    is_inlier
        (N,) which rays agree with it.
    sigma
        Standard deviation of the rays over the assumed one.
    reason
        Why there is no pose; empty otherwise.
    """

    rig_from_world: Pose | None
    is_inlier: Mask
    sigma: float = float("nan")
    reason: str = ""

    def __bool__(self) -> bool:
        return self.rig_from_world is not None


def estimate_pose(rays: FrameRays, predicted: Pose, seed: int = 0, noise: float | None = None) -> FramePose:
    """Estimate the pose of a frame from its rays of known points, starting from a prediction.

    Only if few rays agree with the pose near the prediction, a random search is made.

    Parameters
    ----------
    rays
        The rays.
    predicted
        rig_from_world near which the pose is searched first.
    seed
        Seed of the random search.
    noise
        Standard deviation of the rays over the assumed one; by default it is estimated.
    """
    from omnisight.visual_odometry._ray_pose_kernel import RayPoseProblem

    known = np.flatnonzero(rays.has_point)
    if len(known) < MIN_INLIERS:
        return FramePose(None, rays.has_point, reason=f"{len(known)} points tracked, {MIN_INLIERS} are needed")
    is_known, assumed = noise is not None, noise or 1.0
    order = np.random.default_rng(seed).permutation(known)
    used = rays[order]

    def problem(scale: float) -> RayPoseProblem:
        sigma = scale * assumed
        arrays = used.points, used.origins, used.bearings, used.axes / sigma, sigma**2 * used.variance
        return RayPoseProblem(*map(np.ascontiguousarray, arrays))

    fit = refine(problem(1.0), predicted.matrix, is_scale_known=is_known)
    model, inlier, sigma = fit.model, fit.is_inlier, fit.scale
    if inlier.mean() < MIN_INLIER_SHARE:
        options = RansacOptions(seed=seed, confidence=0.999, max_iterations=500)
        found = estimate_robustly(problem, is_scale_known=is_known, options=options)
        if found.model is not None and found.inliers.sum() > inlier.sum():
            model, inlier, sigma = found.model, found.inliers, found.scale
    is_inlier = np.zeros(len(rays), np.bool_)
    is_inlier[order] = inlier
    if inlier.sum() < MIN_INLIERS:
        return FramePose(None, is_inlier, reason=f"{inlier.sum()} of {len(known)} points agree with a pose")
    return FramePose(Pose.of_matrix(model), is_inlier, sigma * assumed)
