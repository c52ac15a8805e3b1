"""The pose of a frame near a predicted one, if it agrees with the frames before."""

from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from omnisight.visual_odometry.frame import Frame
from omnisight.visual_odometry.pose_estimation import MIN_INLIERS, FramePose, estimate_pose

# Share of the points of the last frame below which a frame shows another place, unless descriptors confirm its pose: a
# few patches of a wrong place agree with a pose by chance, because they are searched near it.
MIN_KEPT = 0.2
# Points that agree with a pose after a loss: twice what a pose needs.
MIN_RELOCALIZED = 2 * MIN_INLIERS
# Frames whose median residual is the noise of the next one.
NOISE_FRAMES = 20
# Growth of the noise above which a pose is verified: frames of rendered rooms, streets and a town that were tracked
# without a gap had up to 1.96 times the noise before, and wrong poses after gaps 2.3 times and more.
MAX_NOISE_GROWTH = 2.0
# Least noise: exact images have none, and their rounding is no measure.
MIN_NOISE = 0.3
# Share of the points that agree with a verified pose. Of 71 wrong poses after gaps of 2 to 25 m, one agreed with 11 of
# 22 points and the others with at most 44 %; right ones that descriptors determined, with 51 % and more.
MIN_VERIFIED_SHARE = 0.5

ANOTHER_PLACE = "{} points agree with a pose, after {} in the frame before: the image shows another place"
INCONSISTENT = "{} of {} points agree with a pose within the noise of the images before"


@dataclass
class FrameLocator:
    """Estimates poses of frames, and keeps the noise of the last ones.

    Attributes
    ----------
    seed
        Seed of the random numbers.
    inliers
        Number of points that agreed with the last pose.
    """

    seed: int
    inliers: int = 0
    _noise: deque[float] = field(default_factory=lambda: deque(maxlen=NOISE_FRAMES), repr=False)

    def locate(self, frame: Frame, *, is_lost: bool) -> FramePose:
        """Return the pose of a frame near the predicted one, or why there is none; `is_lost` after a loss."""
        found = estimate_pose(frame.rays, frame.predicted, self.seed)
        if found and self._noise and (is_lost or found.sigma > MAX_NOISE_GROWTH * self.noise):
            found = self._verified(frame, found)
        agreeing, needed = int(found.is_inlier.sum()), MIN_RELOCALIZED if is_lost else MIN_KEPT * self.inliers
        if found and agreeing < needed:
            return replace(found, rig_from_world=None, reason=ANOTHER_PLACE.format(agreeing, self.inliers))
        return found

    def accept(self, found: FramePose) -> None:
        """Compare the next frames with a pose."""
        self.inliers = int(found.is_inlier.sum())
        self._noise.append(found.sigma)

    def restart(self) -> None:
        """Forget the noise: points of two keyframes are less accurate than those of a window."""
        self._noise.clear()

    @property
    def noise(self) -> float:
        """Standard deviation of rays from points over the assumed one: its median in the last frames, 1 without any."""
        return max(float(np.median(self._noise)), MIN_NOISE) if self._noise else 1.0

    def _verified(self, frame: Frame, found: FramePose) -> FramePose:
        """Return the pose with which most points agree within the noise before, or why there is none.

        An estimate of the noise grows with a wrong pose, because patches are found near where they are predicted.
        """
        assert found.rig_from_world is not None
        verified = estimate_pose(frame.rays, found.rig_from_world, self.seed, self.noise)
        agreeing, known = int(verified.is_inlier.sum()), int(frame.rays.has_point.sum())
        if verified and agreeing > MIN_VERIFIED_SHARE * known:
            return verified
        return replace(verified, rig_from_world=None, reason=INCONSISTENT.format(agreeing, known))
