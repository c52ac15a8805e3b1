"""Visual odometry, frame by frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features.detection import illuminated_region
from omnisight.geometry.pose import Pose
from omnisight.images import to_gray8
from omnisight.odometry.initialization import Initialization, WaitingFrame, common, estimate_rotation
from omnisight.odometry.keyframes import is_keyframe
from omnisight.odometry.marginalization import gauge_prior
from omnisight.odometry.motion_prediction import MotionPrediction
from omnisight.odometry.pose_estimation import FramePose, estimate_pose
from omnisight.odometry.ray_observations import FrameRays
from omnisight.odometry.tracker import Tracker
from omnisight.odometry.window import Keyframe, KeyframeWindow
from omnisight.optim.ransac import RansacOptions
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

GAUGE_SIGMA = 1e-3


@dataclass(frozen=True)
class OdometryOptions:
    """How motion is estimated.

    Attributes
    ----------
    patches
        Number of patches to track, in all images of a frame.
    window
        Number of keyframes that are refined together.
    seed
        Seed of the random numbers.
    """

    patches: int = 400
    window: int = 10
    seed: int = 0


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What is known of a frame.

    Attributes
    ----------
    index, seconds
        Index in the sequence, and time.
    rig_from_world
        The pose; None if it is not known (yet).
    tracked
        Number of patches that agree with it.
    is_keyframe
        Whether it was added to the window.
    reason
        Why there is no pose; empty otherwise.
    """

    index: int
    seconds: float
    rig_from_world: Pose | None
    tracked: int
    is_keyframe: bool = False
    reason: str = ""


class Odometry:
    """Visual odometry."""

    def __init__(self, camera: Camera | RayCamera | Rig, options: OdometryOptions = OdometryOptions(), masks=()) -> None:
        self.rig = camera if isinstance(camera, Rig) else Rig((camera,), (Pose(),), ("camera",))
        self.options = options
        self.trajectory: list[tuple[float, Pose]] = []
        self._masks = masks
        self._tracker: Tracker | None = None
        self._window: KeyframeWindow | None = None
        self._initialization: Initialization | None = None
        self._motion: MotionPrediction | None = None
        self._count = 0

    def add(self, images, seconds: float) -> FrameResult:
        grays = [to_gray8(image) for image in (images if isinstance(images, (list, tuple)) else [images])]
        if self._tracker is None:
            regions = [illuminated_region(g, c) for g, c in zip(grays, self.rig.cameras, strict=True)]
            if self._masks:
                regions = [r & m for r, m in zip(regions, self._masks, strict=True)]
            self._tracker = Tracker(self.rig, regions, self.options.patches)
            self._motion = MotionPrediction.still(seconds, Pose())
        index, self._count = self._count, self._count + 1
        predicted = self._motion.at(seconds)
        rays = self._tracker.track(grays, predicted)
        if self._window is None:
            return self._initialize(index, seconds, grays, rays, predicted)
        estimate = estimate_pose(rays, predicted, self.options.seed)
        if estimate.rig_from_world is None:
            return FrameResult(index, seconds, None, len(rays), reason=estimate.reason)
        pose = estimate.rig_from_world
        self._tracker.confirm(pose, rays, estimate.is_inlier | ~rays.has_point)
        rays = rays[estimate.is_inlier | ~rays.has_point]
        keyframe = is_keyframe(self._window.keyframes[-1], rays, pose)
        if keyframe:
            pose = self._add_keyframe(index, grays, pose)
        self._motion = self._motion.after(seconds, pose)
        self.trajectory.append((seconds, pose))
        return FrameResult(index, seconds, pose, int(estimate.is_inlier.sum()), keyframe)

    def _add_keyframe(self, index: int, grays, pose: Pose) -> Pose:
        self._tracker.detect(grays, pose)
        seen = self._tracker.patches.number[self._tracker.patches.is_seen]
        self._window.add(Keyframe(index, pose, self._tracker.rays(pose)), seen)
        self._tracker.set_points(self._window.number, self._window.points)
        return self._window.keyframes[-1].rig_from_world

    def _initialize(self, index, seconds, grays, rays, predicted) -> FrameResult:
        pose, start = predicted, self._initialization
        if start is not None:
            last = start.waiting[-1] if start.waiting else start.first
            a, b = common(last.rays, rays)
            if len(a) >= 12:
                turn, inlier = estimate_rotation(a, b, predicted.rotation @ last.rotation.rotation.T)
                pose = Pose(turn @ last.rotation.rotation)
                self._tracker.confirm(pose, b, np.ones(len(b), bool))
        frame = WaitingFrame(index, seconds, rays, pose)
        if start is None:
            self._tracker.detect(grays, pose)
            self._initialization = Initialization(replace(frame, rays=self._tracker.rays(pose)))
            return FrameResult(index, seconds, None, 0, reason="initializing")
        start.waiting.append(frame)
        self._motion = self._motion.after(seconds, pose)
        solved = start.solve(RansacOptions(seed=self.options.seed))
        if solved is None:
            return FrameResult(index, seconds, None, len(rays), reason="initializing")
        poses = Pose(), solved
        self._window = KeyframeWindow([], gauge_prior(np.array([p.matrix for p in poses]), GAUGE_SIGMA, has_scale=False), self.options.window)
        w = self._window
        w.keyframes = [Keyframe(start.first.index, poses[0], start.first.rays)]
        self._tracker.detect(grays, poses[1])
        seen = self._tracker.patches.number[self._tracker.patches.is_seen]
        w.add(Keyframe(index, poses[1], self._tracker.rays(poses[1])), seen)
        self._tracker.set_points(w.number, w.points)
        self.trajectory.append((start.first.seconds, w.keyframes[0].rig_from_world))
        for f in start.waiting[:-1]:
            rows = np.minimum(np.searchsorted(w.number, f.rays.number), len(w.number) - 1)
            known = w.number[rows] == f.rays.number
            r = replace(f.rays, points=np.where(known[:, None], w.points[rows], np.nan))
            e = estimate_pose(r, f.rotation)
            if e.rig_from_world is not None:
                self._motion = self._motion.after(f.seconds, e.rig_from_world)
                self.trajectory.append((f.seconds, e.rig_from_world))
        last = self.trajectory[-1]
        self._motion = MotionPrediction.still(last[0], last[1]).after(seconds, w.keyframes[-1].rig_from_world)
        self.trajectory.append((seconds, w.keyframes[-1].rig_from_world))
        self._initialization = None
        return FrameResult(index, seconds, w.keyframes[-1].rig_from_world, len(rays), True)
