"""Focal length that the images of a recording agree with best, relative to that of the calibration."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.diagnosis.frame_pairs import SeenFrame
from omnisight.diagnosis.relative_motion import RelativeMotion, weighted_mean
from omnisight.sfm.calibration_check import FocalLengthChange, scaling_basis
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Runs that are measured at least.
MIN_RUNS = 4
# Relative focal length of the finite difference.
STEP = 1e-3
# Gauss-Newton steps, and their size, in standard deviations, below which they end. The relative poses are estimated
# again after each.
MAX_ROUNDS, CONVERGED_SIGMA = 6, 0.2
# Change beyond which the estimate diverges: with no smaller one the images agree.
MAX_CHANGE = 0.7


def estimate_focal_length_change(camera: Camera, runs: Sequence[Sequence[SeenFrame]]) -> FocalLengthChange | None:
    """Estimate the focal length from the first and the last image of each run; None if they do not determine it.

    The residuals of a relative pose are linear in small changes of the focal length, which is estimated together with a
    step of the pose, by least squares over the inliers of each pair.
    """
    basis = scaling_basis(camera)
    if basis is None:
        return None
    change = 0.0
    for _ in range(MAX_ROUNDS):
        now, later = (_scaled(camera, basis, relative) for relative in (change, change + STEP))
        found = [each for run in runs if len(run) > 1 for each in _of_run(camera, now, later, run)]
        if len(found) < MIN_RUNS:
            return None
        step, sigma = weighted_mean(found)
        change += step
        if abs(step) < CONVERGED_SIGMA * sigma:
            return FocalLengthChange(change, sigma)
        if abs(change) > MAX_CHANGE:
            return None
    return None


def _scaled(camera: Camera, basis: Array, relative: float) -> Camera:
    """Return the camera with a focal length that is changed by a ratio."""
    return replace(camera, model=camera.model.with_params(camera.model.params + relative * basis[:, 0]))


def _of_run(camera: Camera, now: Camera, later: Camera, run: Sequence[SeenFrame]) -> list[tuple[float, float]]:
    """Return the change of the focal length with its standard deviation, from two cameras `STEP` apart, if known."""
    ends = (replace(frame, rays=_seen_by(now, camera, frame.rays)) for frame in (run[0], run[-1]))
    motion = RelativeMotion.of(*(replace(end, rays=end.rays[_is_known(end.rays)]) for end in ends))
    if motion is None or motion.is_rotation:
        return []
    first, second = (_seen_by(later, now, rays) for rays in (motion.first, motion.second))
    use = _is_known(first) & _is_known(second)
    return replace(motion, first=motion.first[use], second=motion.second[use]).parameter(first[use], second[use], STEP)


def _is_known(rays: FrameRays) -> Mask:
    """Return which rays (N,) a camera has."""
    return np.asarray(np.isfinite(rays.axes).all(axis=(1, 2)) & np.isfinite(rays.bearings).all(axis=1), np.bool_)


def _seen_by(now: Camera, before: Camera, rays: FrameRays) -> FrameRays:
    """Return the rays (N) of another camera for the same pixels and their errors; NaN where it has none."""

    def moved(directions: Array) -> Array:
        return now.unproject(before.project(directions)[0])[0]

    # Directions of one standard deviation, which errors of pixels become.
    errors = np.moveaxis(np.linalg.pinv(rays.axes), 2, 0)
    after = np.stack([moved(rays.bearings + error) - moved(rays.bearings - error) for error in errors], axis=-1) / 2
    valid, axes = np.isfinite(after).all(axis=(1, 2)), np.full_like(rays.axes, np.nan)
    axes[valid] = np.linalg.pinv(after[valid])
    return replace(rays, bearings=moved(rays.bearings), axes=axes)
