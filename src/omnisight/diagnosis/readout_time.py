"""Time in which the rows of an image are read, from patches in consecutive images of a camera that turns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.diagnosis.frame_pairs import SeenFrame
from omnisight.diagnosis.relative_motion import RelativeMotion, weighted_mean
from omnisight.geometry import rotation as so3
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]

# Turn rate (degrees per second) below which rows show no delay.
MIN_TURN_RATE_DEG = 5.0
# Pairs of images that are measured at least, and at most.
MIN_PAIRS, MAX_PAIRS = 6, 60
# Readout time (seconds) of the finite difference.
STEP_S = 1e-3
# Inverse distance, over the length of the translation, of points that are nearer than the camera moved.
MAX_INVERSE_DISTANCE = 1.0


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
    # The scatter of the pairs includes what the model neglects, such as turn rates that change between the images.
    return None if len(found) < MIN_PAIRS else ReadoutTime(*weighted_mean(found))


def _of_pair(camera: Camera, step: RelativeMotion, rates: tuple[Array, Array]) -> list[tuple[float, float]]:
    """Return the readout time with its standard deviation, given the turn rates (3,) at both images, if it is known."""
    first, second = (
        _without_delay(camera, rays, np.cross(rate, rays.bearings) + shift)
        for rays, rate, shift in zip((step.first, step.second), rates, _translational(step), strict=True)
    )
    return step.parameter(first, second, STEP_S)


def _translational(motion: RelativeMotion) -> tuple[Array, Array]:
    """Return the velocities (N, 3) of the bearings in both images by the translation, radians per second.

    The motion is a screw: its velocity is t - w x t / 2 per interval, to second order in its angle w.
    """
    a, b = motion.first.bearings, motion.second.bearings
    if motion.is_rotation:
        return np.zeros_like(a), np.zeros_like(b)
    rotation, t = motion.model[:, :3], motion.model[:, 3]
    velocity = (t - np.cross(so3.log(rotation), t) / 2) / motion.seconds
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


def _without_delay(camera: Camera, rays: FrameRays, velocities: Array) -> FrameRays:
    """Return rays (N) at the time of the middle row, if the readout takes `STEP_S`, given their velocities (N, 3)."""
    pixels, _ = camera.project(rays.bearings)
    delay = STEP_S * ((pixels[:, 1] + 0.5) / camera.height - 0.5)
    moved = rays.bearings - delay[:, None] * velocities
    return replace(rays, bearings=moved / np.linalg.norm(moved, axis=1, keepdims=True))
