"""The first two keyframes: the first frames between which the camera moved far enough."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.refinement import refine
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose
from omnisight.visual_odometry.car_motion import estimate_car_motion
from omnisight.visual_odometry.frame_result import TrackedPose
from omnisight.visual_odometry.marginalization import gauge_prior
from omnisight.visual_odometry.pose_estimation import MIN_INLIERS, estimate_pose
from omnisight.visual_odometry.ray_observations import FrameRays, common
from omnisight.visual_odometry.window import Keyframe, KeyframeWindow

Array = NDArray[np.float64]

# Median parallax over its noise at which distances are known to about 5 %.
MIN_PARALLAX_SIGMA = 20.0
# Ratio of the parallax to that of the last attempt at which another attempt is made.
RETRY_PARALLAX_RATIO = 1.2
# Median parallax over its noise below which the camera only turned.
MAX_ROTATION_SIGMA = 3.0
# Patches that both frames must show.
MIN_COMMON = 30
# Share of the patches of the first frame below which it is replaced.
MIN_SHARE = 0.4
# Frames that wait for their pose: they need memory.
MAX_WAITING = 300
# Share of the pairs that agree with the motion of a car; fewer agree with that of another vehicle.
MIN_CAR_SHARE = 0.5
# Models of motion that determine a translation.
SOLVED = "general", "planar motion", "dominant plane"
# Standard deviation of the fixed pose and scale, which does not matter to the solution.
GAUGE_SIGMA = 1e-3
# Corners of an image that shows something: twice what a pose needs.
MIN_CORNERS = 2 * MIN_INLIERS

NO_PATCHES = "consecutive images show nothing in common, or no texture"
NO_PARALLAX = "the parallax ({:.1f} times its noise) determined no motion before the image changed"
COVERED = "{} corners: the lens is covered, or the image is dark, blurred or uniform"


@dataclass(frozen=True, eq=False)
class WaitingFrame:
    """A frame without a known position.

    Attributes
    ----------
    frame, seconds
        Index in the sequence, and time.
    rays
        Its rays.
    pose
        Its rotation, at the position of the first frame.
    images
        Its gray images; none but for the first frame.
    """

    frame: int
    seconds: float
    rays: FrameRays
    pose: Pose
    images: tuple[NDArray[np.uint8], ...] = ()


@dataclass
class Initialization:
    """Frames that wait for a sufficient parallax.

    Attributes
    ----------
    frames
        The first one, which becomes a keyframe, and those since.
    speed
        Assumed speed in units of the world, for the scale; the length of the baseline is 1 if it is zero.
    vehicle_from_rig
        Rotation (3, 3) to the axes of a car, on which the camera is; None if it moves in other ways.
    parallax
        Median parallax of the last frame over its noise; infinite while too few patches are common.
    """

    frames: list[WaitingFrame]
    speed: float = 0.0
    vehicle_from_rig: Array | None = None
    parallax: float = np.inf
    _tried: float = field(default=MIN_PARALLAX_SIGMA / RETRY_PARALLAX_RATIO, repr=False)

    @property
    def first(self) -> WaitingFrame:
        """The first frame."""
        return self.frames[0]

    def turn(self, rays: FrameRays, predicted: Pose, seed: int) -> Pose:
        """Return the pose of the next frame, with the rotation that explains its rays best."""
        last = self.frames[-1]
        a, b = common(last.rays, rays)
        if len(a) < MIN_COMMON:
            return predicted
        turn = estimate_rotation(a, b, predicted.rotation @ last.pose.rotation.T, seed)
        return Pose(turn @ last.pose.rotation, turn @ last.pose.translation)

    def solve(self, window_size: int, options: RansacOptions) -> KeyframeWindow | None:
        """Return a window with the first and the last frame, once the parallax suffices."""
        last = self.frames[-1]
        a, b = common(self.first.rays, last.rays)
        if len(a) < MIN_COMMON:
            self.parallax = np.inf
            return None
        turn = last.pose.rotation @ self.first.pose.rotation.T
        chord = np.linalg.norm(a.bearings @ turn.T - b.bearings, axis=1)
        self.parallax = float(np.median(chord / np.sqrt(a.variance + b.variance)))
        if self.parallax < self._tried * RETRY_PARALLAX_RATIO:
            return None
        self._tried = self.parallax
        pairs = BearingPairs(a.bearings, b.bearings, a.covariance, b.covariance, is_noise_known=False)
        found = self._relative_pose(pairs, options)
        if found is None:
            return None
        length = self.speed * (last.seconds - self.first.seconds) or 1.0
        return self.window(Pose(found.rotation, length * found.translation), window_size)

    def _relative_pose(self, pairs: BearingPairs, options: RansacOptions) -> Pose | None:
        """Return the relative pose of a car, if most pairs agree with it, or else of any motion; None if unknown."""
        if self.vehicle_from_rig is not None:
            car = estimate_car_motion(pairs, self.vehicle_from_rig, options)
            if car.model is not None and car.inliers.mean() > MIN_CAR_SHARE:
                return Pose.of_matrix(car.model)
        found = estimate_relative_pose(pairs, options)
        is_solved = found.motion.name in SOLVED and found.alternative is None
        return found.b_from_a if is_solved else None

    def window(self, last_from_first: Pose, size: int, *, has_scale: bool = False) -> KeyframeWindow:
        """Return a window of the first and the last frame with a relative pose.

        Without a scale, the rays of a rig start at one point.
        """
        first, last = ((f.rays if has_scale else f.rays.from_one_point()) for f in (self.first, self.frames[-1]))
        poses = self.first.pose, last_from_first @ self.first.pose
        sigma = GAUGE_SIGMA * float(np.linalg.norm(last_from_first.translation))
        prior = gauge_prior(np.array([pose.matrix for pose in poses]), sigma, has_scale=has_scale)
        window = KeyframeWindow(Keyframe(self.first.frame, poses[0], self.first.images), first, prior, size)
        window.add(Keyframe(self.frames[-1].frame, poses[1]), last, FrameRays.none(), last.number)
        return window

    def is_sudden(self, rays: FrameRays) -> bool:
        """Return whether the next frame shows few patches of the last one."""
        both, _ = common(self.frames[-1].rays, rays)
        return len(both) < MIN_SHARE * len(self.frames[-1].rays)

    def needs_restart(self) -> bool:
        """Return whether the last frame shows too few patches of the first one, or too many frames wait."""
        both, _ = common(self.first.rays, self.frames[-1].rays)
        needed = max(MIN_COMMON, MIN_SHARE * len(self.first.rays))
        return len(both) < needed or len(self.frames) > MAX_WAITING

    def turned_only(self) -> bool:
        """Return whether the camera turned without moving since the first frame."""
        return self.parallax < MAX_ROTATION_SIGMA

    @property
    def failure(self) -> str:
        """Why the frames have no position."""
        if (corners := len(self.first.rays)) < MIN_CORNERS:
            return COVERED.format(corners)
        return NO_PARALLAX.format(self.parallax) if np.isfinite(self.parallax) else NO_PATCHES

    def rotations(self) -> list[TrackedPose]:
        """Return the poses of a camera that turned without moving, all but the last."""
        return [TrackedPose(w.frame, w.seconds, w.pose, "rotation only") for w in self.frames[:-1]]

    def trajectory(self, window: KeyframeWindow, seed: int) -> tuple[list[TrackedPose], list[int]]:
        """Return the poses of the frames, given the window, and the indices of frames without a pose."""
        first, last = window.keyframes[0].rig_from_world, window.keyframes[-1].rig_from_world
        poses, missing = [TrackedPose(self.first.frame, self.first.seconds, first)], list[int]()
        for waiting in self.frames[1:-1]:
            rays = with_points(waiting.rays, window)
            found = estimate_pose(rays, Pose(waiting.pose.rotation, waiting.pose.translation), seed)
            if found.rig_from_world is None:
                missing.append(waiting.frame)
            else:
                poses.append(TrackedPose(waiting.frame, waiting.seconds, found.rig_from_world))
        poses.append(TrackedPose(self.frames[-1].frame, self.frames[-1].seconds, last))
        return poses, missing


def with_points(rays: FrameRays, window: KeyframeWindow) -> FrameRays:
    """Return the rays with the points of a window."""
    if not len(window.number):
        return replace(rays, points=np.full((len(rays), 3), np.nan))
    rows = np.minimum(np.searchsorted(window.number, rays.number), len(window.number) - 1)
    is_known = window.number[rows] == rays.number
    return replace(rays, points=np.where(is_known[:, None], window.points[rows], np.nan))


def estimate_rotation(a: FrameRays, b: FrameRays, predicted: Array, seed: int) -> Array:
    """Return the rotation (3, 3) that explains the rays (N) of two consecutive frames best.

    Parallax is small, and its directions differ: it counts as noise of unknown size. The search starts at the predicted
    rotation or at that of least squares (G. Wahba, A least squares estimate of satellite attitude, 1965), whichever
    fits the median ray better: from a start that is wrong by many standard deviations, all rays look like outliers.
    """
    from omnisight.twoview._alignment_problems_kernel import RotationProblem

    order = np.random.default_rng(seed).permutation(len(a))
    a, b = a[order], b[order]
    pairs = BearingPairs(a.bearings, b.bearings, a.covariance, b.covariance, is_noise_known=False)
    starts = predicted, so3.nearest(b.bearings.T @ a.bearings)
    best = min(starts, key=lambda turn: float(np.median(np.linalg.norm(a.bearings @ turn.T - b.bearings, axis=1))))
    start = np.column_stack([best, np.zeros(3)])
    return refine(RotationProblem.of(pairs), start, is_scale_known=False).model[:, :3]


def lost_ranges(frames: Sequence[int]) -> list[tuple[int, int]]:
    """Return the first and the last of each run of consecutive indices."""
    edges = np.flatnonzero(np.diff(frames) != 1) + 1
    return [(int(run[0]), int(run[-1])) for run in np.split(np.array(frames, int), edges) if len(run)]
