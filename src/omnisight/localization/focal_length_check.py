"""Whether localized images agree with the focal length of their camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.localization.localize import LocalizedImage
from omnisight.localization.matched_points import MatchedPoints
from omnisight.optim.block_jackknife import measured_variance_ratio
from omnisight.sfm.calibration_check import FocalLengthChange, scaling_basis

Array = NDArray[np.float64]

# Largest number of Gauss-Newton steps, and their size, in standard deviations, below which they end. The images are
# resected after each step, which finds more inliers. Focal lengths that were wrong by 2 to 5 % took 3 or 4 steps.
MAX_ROUNDS, CONVERGED_SIGMA = 10, 0.1


@dataclass(frozen=True, eq=False)
class _Resection:
    """The pose of an image that its matches determine, for some focal length of its camera.

    Attributes
    ----------
    matched, cam_from_world, is_inlier
        The matches, the pose, and which matches agree with it.
    basis
        (P, 1), see `scaling_basis`.
    """

    matched: MatchedPoints
    cam_from_world: Pose
    is_inlier: NDArray[np.bool_]
    basis: Array

    @classmethod
    def of(cls, image: LocalizedImage) -> Self | None:
        """Return the resection of an image; None if its pose or its uncertainty is unknown."""
        if image.cam_from_world is None or image.matched_points is None or not np.isfinite(image.covariance).all():
            return None
        basis = scaling_basis(image.matched_points.camera)
        return None if basis is None else cls(image.matched_points, image.cam_from_world, image.is_inlier, basis)

    def with_focal_length(self, relative: float) -> Self | None:
        """Return the resection with a focal length that is changed by a ratio; None if there is no pose."""
        camera = self.matched.camera
        model = camera.model.with_params(camera.model.params + relative * self.basis[:, 0])
        matched = self.matched.seen_by(replace(camera, model=model))
        found = matched.resect()
        if found.cam_from_world is None:
            return None
        return replace(self, matched=matched, cam_from_world=found.cam_from_world, is_inlier=found.inliers)

    def step_by(self, relative: float) -> Array:
        """Return the step (6,) of the pose that a change of the focal length by a ratio causes, to first order."""
        linearized = self.matched[self.is_inlier].linearize(self.cam_from_world)
        return linearized.response(linearized.by_params @ (relative * self.basis))[:, 0]

    def derivatives(self) -> tuple[Array, Array, Array, Array]:
        """Return residuals (N, 2, 1), their derivatives by focal length and by calibration (N, 2, Q), and the points.

        The part that a step of the pose explains is subtracted.
        """
        inliers = self.matched[self.is_inlier]
        linearized = inliers.linearize(self.cam_from_world)
        by_scale, by_calibration = linearized.by_params @ self.basis, linearized.by_params @ inliers.calibration
        residuals = linearized.beyond_pose(linearized.residuals[:, :, None])
        return residuals, linearized.beyond_pose(by_scale), linearized.beyond_pose(by_calibration), inliers.points


def check_focal_length(images: Sequence[LocalizedImage]) -> tuple[list[LocalizedImage], FocalLengthChange | None]:
    """Estimate the change of the focal length that all images agree with best.

    If it is significant, and moves the poses by more than their standard deviations, the shift of each pose is added to
    its covariance. The poses stay those of the given camera: the map may be wrong as well.

    Parameters
    ----------
    images
        Of one camera.

    Returns
    -------
    images
        With the covariances.
    change
        None if it is not significant or does not move the poses.
    """
    known = {k: resection for k, image in enumerate(images) if (resection := _Resection.of(image)) is not None}
    change, moved = _significant_change(known)
    if change is None:
        return list(images), None
    steps = {
        k: each.cam_from_world.step_to(moved[k].cam_from_world) if k in moved else each.step_by(change.relative)
        for k, each in known.items()
    }
    squares = [step @ np.linalg.solve(images[k].covariance, step) for k, step in steps.items()]
    if np.mean(squares) < 1:
        return list(images), None
    found = list(images)
    for k, step in steps.items():
        found[k] = replace(found[k], covariance=found[k].covariance + np.outer(step, step))
    return found, change


def _significant_change(known: dict[int, _Resection]) -> tuple[FocalLengthChange | None, dict[int, _Resection]]:
    """Return the change of the focal length and the resections with it; None and nothing if it is not significant."""
    change, current, total = None, known, 0.0
    for _ in range(MAX_ROUNDS):
        step = _gauss_newton_step(list(current.values()))
        if step is None:
            return None, {}
        total += step.relative
        change = FocalLengthChange(total, step.sigma)
        if not change.is_significant:
            return None, {}
        current = {k: new for k, old in known.items() if (new := old.with_focal_length(total)) is not None}
        if abs(step.relative) < CONVERGED_SIGMA * step.sigma:
            break
    return change, current


def _gauss_newton_step(resections: Sequence[_Resection]) -> FocalLengthChange | None:
    """Return the change of the focal length by one Gauss-Newton step of all poses and it; None if it is unknown.

    The variance is that of independent errors of the bearings times the ratio that a jackknife over blocks of points
    measures, if it is above 1, and that due to the covariance of the calibration.
    """
    if not resections:
        return None
    residuals, by_scale, by_calibration, points = (
        np.concatenate(parts) for parts in zip(*(each.derivatives() for each in resections), strict=True)
    )
    information = float((by_scale**2).sum())
    if not information > 0:
        return None
    relative = -float((by_scale * residuals).sum()) / information
    left = residuals + relative * by_scale
    ratio = max(measured_variance_ratio(left[:, :, 0], by_scale, points), 1.0)
    response = (by_scale * by_calibration).sum(axis=(0, 1)) / information
    return FocalLengthChange(relative, float(np.sqrt(ratio / information + response @ response)))
