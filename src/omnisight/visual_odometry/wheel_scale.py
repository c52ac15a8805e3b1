"""The scale of a trajectory from the speed of wheels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.visual_odometry.scale_estimate import MIN_MEASUREMENTS, ScaleEstimate, robust_mean

Array = NDArray[np.float64]

# Duration (seconds) of the parts whose lengths are compared.
PART_S = 1.0
# Relative standard deviation of the radius of a tyre: load, pressure and wear.
RADIUS_SIGMA = 0.01
# Share of the longest part below which the vehicle is nearly at rest.
MIN_SHARE = 0.1
# Largest step (seconds) between samples of the speed, and between images.
MAX_STEP_S = 2.5


class WheelSpeeds(NamedTuple):
    """Times (N,), seconds, and forward speeds (N,), m/s."""

    times: Array
    speed: Array

    def distance(self, times: Array) -> Array:
        """Return the distances driven (M,) until times (M,), metres; NaN outside the samples or in a gap."""
        steps = np.diff(self.times)
        driven = np.concatenate([[0.0], np.cumsum(steps * (self.speed[1:] + self.speed[:-1]) / 2)])
        row = np.clip(np.searchsorted(self.times, times) - 1, 0, len(steps) - 1)
        rest = times - self.times[row]
        speed = self.speed[row] + (self.speed[row + 1] - self.speed[row]) * rest / steps[row]
        known = (times >= self.times[0] - 1e-6) & (times <= self.times[-1] + 1e-6) & (steps[row] <= MAX_STEP_S)
        return np.where(known, driven[row] + rest * (self.speed[row] + speed) / 2, np.nan)


def scale_from_wheels(times: Array, centers: Array, wheels: WheelSpeeds) -> ScaleEstimate:
    """Return the scale of positions (N, 3) of a camera at times (N,), from the speed of the wheels.

    The camera is assumed to move as fast as the wheels: in turns, that is so for a camera near the rear axle.
    """
    source = "the wheels"
    if len(times) < 2:
        return ScaleEstimate(source, reason="there are no consecutive poses")
    driven = np.abs(np.diff(wheels.distance(times)))
    moved = np.linalg.norm(np.diff(centers, axis=0), axis=1)
    part = ((times[1:] - times[0]) / PART_S).astype(int)
    known = np.isfinite(driven) & (np.diff(times) <= MAX_STEP_S)
    if not known.any():
        return ScaleEstimate(source, reason=_mismatch(times, wheels.times))
    count = int(part.max()) + 1
    metres, units = (np.bincount(part[known], values[known], count) for values in (driven, moved))
    use = (metres > MIN_SHARE * metres.max()) & (units > 0)
    if use.sum() < MIN_MEASUREMENTS:
        return ScaleEstimate(source, reason=f"the wheels moved in {use.sum()} seconds, {MIN_MEASUREMENTS} are needed")
    scale, sigma = robust_mean(metres[use] / units[use])
    return ScaleEstimate.checked(source, scale, float(np.hypot(sigma / scale, RADIUS_SIGMA)))


def _mismatch(images: Array, speeds: Array) -> str:
    """Return why speeds at times (N,) do not determine the distances between images at times (M,)."""
    if max(images[0], speeds[0]) > min(images[-1], speeds[-1]):
        return (
            f"speeds are known from {speeds[0]:.3f} to {speeds[-1]:.3f} s, the images are from {images[0]:.3f} to"
            f" {images[-1]:.3f} s: use the same clock for both"
        )
    steps = [float(np.median(np.diff(times))) for times in (images, speeds)]
    return (
        f"the images are {steps[0]:.1f} s apart, and the speeds {steps[1]:.1f} s: at most {MAX_STEP_S:g} s are possible"
    )
