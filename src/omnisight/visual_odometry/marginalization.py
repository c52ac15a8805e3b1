"""What is known of the poses of a window from frames and points that have left it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from omnisight.geometry import rotation as so3
from omnisight.optim.blas_threads import blas_threads_for
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.measurements import LinearizedMeasurements

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Directions of less information than this share of the largest are unknown: rounding, as they are after scaling.
MIN_INFORMATION = 1e-12


@dataclass(frozen=True, eq=False)
class PosePrior:
    """A Gaussian prior of the poses of frames, linearized at given poses.

    Attributes
    ----------
    frames
        (K,) their indices.
    poses
        (K, 3, 4) rig_from_world at which it is linearized.
    residuals
        (R,) whitened residuals there.
    derivatives
        (R, K, 6) by steps of the poses, see `Pose.moved`.
    """

    frames: Indices
    poses: Array
    residuals: Array
    derivatives: Array
    fixes_gauge = True

    @classmethod
    def of_normal_equations(cls, frames: Indices, poses: Array, information: Array, gradient: Array) -> "PosePrior":
        """Return the prior with the information (6 K, 6 K) and the gradient (6 K,) of its cost."""
        diagonal = np.diagonal(information)
        # A difference of equal information is rounding, and can be negative.
        root = np.sqrt(np.where(diagonal > np.finfo(float).eps * diagonal.max(), diagonal, np.inf))
        scale = 1.0 / root
        with blas_threads_for(len(information)):
            values, vectors = eigh(scale[:, None] * information * scale, check_finite=False)
        use = values > MIN_INFORMATION * values[-1]
        values, vectors = values[use], vectors[:, use]
        derivatives = (vectors * np.sqrt(values)).T * np.where(np.isfinite(root), root, 0.0)
        residuals = (vectors.T @ (scale * gradient)) / np.sqrt(values)
        return cls(frames, poses, residuals, derivatives.reshape(-1, len(frames), 6))

    def linearize(self, rig_from_world: Array) -> LinearizedMeasurements:
        """Return residuals and derivatives at poses (F, 3, 4); the derivatives are those of the linearization."""
        now = rig_from_world[self.frames]
        turned = so3.log(now[:, :, :3] @ self.poses[:, :, :3].transpose(0, 2, 1))
        steps = np.concatenate([turned, now[:, :, 3] - self.poses[:, :, 3]], axis=1)
        residuals = self.residuals + self.derivatives.reshape(-1, steps.size) @ steps.ravel()
        frames = np.broadcast_to(self.frames, (len(residuals), len(self.frames)))
        return LinearizedMeasurements(residuals, frames, self.derivatives)

    def shifted(self, frames: Indices) -> "PosePrior":
        """Return the prior for frames with other indices (K,)."""
        return PosePrior(frames, self.poses, self.residuals, self.derivatives)


def gauge_prior(poses: Array, sigma: float, *, has_scale: bool) -> PosePrior:
    """Return a prior that keeps the pose of the first of two frames, and, without a scale, their distance.

    Parameters
    ----------
    poses
        (2, 3, 4) rig_from_world.
    sigma
        Standard deviation, which does not matter to the solution: radians and unit of the world.
    has_scale
        Whether the rig determines the scale.
    """
    rows = np.zeros((6 if has_scale else 7, 2, 6))
    rows[np.arange(6), 0, np.arange(6)] = 1.0 / sigma
    if not has_scale:
        centers = -np.einsum("fji,fj->fi", poses[:, :, :3], poses[:, :, 3])
        baseline = poses[1, :, :3] @ (centers[1] - centers[0])
        rows[6, 1, 3:] = -baseline / np.linalg.norm(baseline) / sigma
    return PosePrior(np.arange(2), poses, np.zeros(len(rows)), rows)


def marginalize_first(bundle: Bundle, prior: PosePrior) -> PosePrior:
    """Return the prior of all other frames that a prior, and a bundle with its points and its first frame imply.

    The points and the pose are eliminated by the Schur complement at the start of the bundle (G. Sibley, L. Matthies
    and G. Sukhatme, Sliding window filter with application to planetary landing, 2010).
    """
    poses = bundle.start.rig_from_world
    count = 6 * len(poses)
    # Frames without any of the points have columns only in the prior.
    points_only = replace(bundle, measured=replace(prior, residuals=np.zeros(0), derivatives=prior.derivatives[:0]))
    matrix, right, _ = points_only.linearize(bundle.start).reduced()
    reduced = matrix.toarray()
    columns = points_only.parameters[0].ravel()
    of_prior = prior.linearize(poses)
    rows = np.zeros((len(of_prior.residuals), len(poses), 6))
    rows[:, prior.frames] = of_prior.derivatives
    rows = rows.reshape(-1, count)
    information, gradient = rows.T @ rows, rows.T @ of_prior.residuals
    free = np.flatnonzero(columns >= 0)
    information[np.ix_(free, free)] += reduced[np.ix_(columns[free], columns[free])]
    gradient[free] += right[columns[free]]
    gone, kept = information[:6, :6], information[6:, 6:]
    gain = information[6:, :6] @ np.linalg.pinv(gone, hermitian=True)
    kept = kept - gain @ information[:6, 6:]
    return PosePrior.of_normal_equations(
        np.arange(len(poses) - 1), poses[1:], (kept + kept.T) / 2, gradient[6:] - gain @ gradient[:6]
    )
