"""Time in which the rows of an image are read, from patches in consecutive images of a camera that turns."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.diagnosis.frame_pairs import SeenFrame
from omnisight.geometry import rotation as so3
from omnisight.optim.ransac import RansacOptions
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose
from omnisight.visual_odometry.ray_observations import FrameRays, common

Array = NDArray[np.float64]

# Turn rate (degrees per second) below which rows show no delay.
MIN_TURN_RATE_DEG = 5.0
# Pairs of images that are measured at least, and at most.
MIN_PAIRS, MAX_PAIRS = 6, 60
# Readout time (seconds) of the finite difference.
STEP_S = 1e-3
MAX_SAMPLES = 500
# Inverse distance, over the length of the translation, of points that are nearer than the camera moved.
MAX_INVERSE_DISTANCE = 1.0
# Correspondences of a pair: a step of the pose and the readout time have six parameters.
MIN_INLIERS = 30


@dataclass(frozen=True)
class ReadoutTime:
    """The time from the first to the last row, seconds, and its standard deviation."""

    seconds: float
    sigma: float


def estimate_readout_time(camera: Camera, runs: Sequence[Sequence[SeenFrame]]) -> ReadoutTime | None:
    """Estimate the readout time from runs of consecutive images; None if the camera turns in too few.

    Row v of an image of height H is read t (v/H - 1/2) after its middle row. In a camera with the turn rate w,
    a bearing b is shifted by t (v/H - 1/2) w x b. The residuals of a relative pose are linear in t, which is estimated
    together with a step of the pose, by least squares over the inliers of each pair. A constant turn shows it only by
    patches that change their row.
    """
    found = list[tuple[float, float]]()
    for run in runs:
        steps = [RelativeMotion.of(a, b) for a, b in pairwise(run)]
        for before, step, after in zip(steps, steps[1:], steps[2:], strict=False):
            if before is None or step is None or after is None or len(found) == MAX_PAIRS:
                continue
            rates = (before.rate + step.rate) / 2, (step.rate + after.rate) / 2
            if np.degrees(max(np.linalg.norm(rate) for rate in rates)) > MIN_TURN_RATE_DEG:
                found += _of_pair(camera, step, rates)
    if len(found) < MIN_PAIRS:
        return None
    times, sigmas = np.array(found).T
    weights = 1.0 / sigmas**2
    mean = float((weights * times).sum() / weights.sum())
    # The scatter of the pairs includes what the model neglects, such as turn rates that change between the images.
    excess = max(float(((times - mean) ** 2 * weights).sum()) / (len(times) - 1), 1.0)
    return ReadoutTime(mean, float(np.sqrt(excess / weights.sum())))


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """The relative pose of two consecutive images, with the rays (N) that agree with it.

    Attributes
    ----------
    first, second
        The rays.
    model
        (3, 4) relative pose.
    is_rotation
        Whether the camera only turned.
    seconds
        Time between the images.
    """

    first: FrameRays
    second: FrameRays
    model: Array
    is_rotation: bool
    seconds: float

    @property
    def rate(self) -> Array:
        """Turn rate (3,), radians per second."""
        return so3.log(self.model[:, :3]) / self.seconds

    @classmethod
    def of(cls, a: SeenFrame, b: SeenFrame) -> "RelativeMotion | None":
        """Estimate the relative pose; None if there is none."""
        first, second = common(a.rays, b.rays)
        pairs = BearingPairs(first.bearings, second.bearings, first.covariance, second.covariance, is_noise_known=False)
        found = estimate_relative_pose(pairs, RansacOptions(max_iterations=MAX_SAMPLES))
        if found.b_from_a is None or found.inliers.sum() < MIN_INLIERS:
            return None
        used, is_rotation = found.inliers, found.motion.name == "rotation only"
        return cls(first[used], second[used], found.b_from_a.matrix, is_rotation, b.seconds - a.seconds)

    def linearized(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Return whitened residuals (M,), and derivatives (M, P) by a step of the pose, for bearings (N, 3)."""
        from omnisight.optim._robust_problem_kernel import linearized
        from omnisight.twoview._alignment_problems_kernel import RotationProblem
        from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

        covariances = self.first.covariance, self.second.covariance
        pairs = BearingPairs(first, second, *covariances, is_noise_known=False)
        kind = RotationProblem if self.is_rotation else RelativePoseProblem
        residuals, jacobian = linearized(kind.of(pairs), self.model)
        return residuals.ravel(), jacobian.reshape(residuals.size, -1)

    def translational(self) -> tuple[Array, Array]:
        """Return the velocities (N, 3) of the bearings in both images by the translation, radians per second.

        The motion is a screw: its velocity is t - w x t / 2 per interval, to second order in its angle w.
        """
        a, b = self.first.bearings, self.second.bearings
        if self.is_rotation:
            return np.zeros_like(a), np.zeros_like(b)
        rotation, t = self.model[:, :3], self.model[:, 3]
        velocity = (t - np.cross(so3.log(rotation), t) / 2) / self.seconds
        p = a @ rotation.T
        c = np.cross(p, b)
        # Distances along p and b are -(t x b).c/|c|^2 and -(t x p).c/|c|^2.
        square = (c**2).sum(axis=1)
        across = [np.maximum(-(np.cross(t, other) * c).sum(axis=1), 1e-12) for other in (b, p)]
        inverse = [np.minimum(square / value, MAX_INVERSE_DISTANCE)[:, None] for value in across]
        return tuple(
            scale * (velocity - bearings * (bearings @ velocity)[:, None])
            for scale, bearings in zip(inverse, (a, b), strict=True)
        )


def _of_pair(camera: Camera, step: RelativeMotion, rates: tuple[Array, Array]) -> list[tuple[float, float]]:
    """Return the readout time with its standard deviation, given the turn rates (3,) at both images, if it is known."""
    r, jacobian = step.linearized(step.first.bearings, step.second.bearings)
    shifted, _ = step.linearized(
        *(
            _without_delay(camera, rays.bearings, np.cross(rate, rays.bearings) + shift)
            for rays, rate, shift in zip((step.first, step.second), rates, step.translational(), strict=True)
        )
    )
    columns = np.column_stack([jacobian, (shifted - r) / STEP_S])
    use = np.isfinite(columns).all(axis=1) & np.isfinite(r)
    r, columns = r[use], columns[use]
    solution = -np.linalg.lstsq(columns, r, rcond=None)[0]
    variance = float(((r + columns @ solution) ** 2).sum()) / max(len(r) - columns.shape[1], 1)
    covariance = variance * np.linalg.pinv(columns.T @ columns, hermitian=True)
    sigma = float(np.sqrt(covariance[-1, -1]))
    return [(float(solution[-1]), sigma)] if 0 < sigma < np.inf else []


def _without_delay(camera: Camera, bearings: Array, velocities: Array) -> Array:
    """Return bearings (N, 3) at the time of the middle row, if the readout takes `STEP_S`, given their velocities."""
    pixels, _ = camera.project(bearings)
    delay = STEP_S * ((pixels[:, 1] + 0.5) / camera.height - 0.5)
    moved = bearings - delay[:, None] * velocities
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)
