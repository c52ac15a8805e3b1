"""Visual odometry, frame by frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.parallel import in_background
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.visual_odometry.central_rig import at_one_point, central_rig, has_baseline
from omnisight.visual_odometry.descriptor_rotation import rotation_by_descriptors
from omnisight.visual_odometry.frame import Frame, check_sizes, check_time, gray_images, usable_regions
from omnisight.visual_odometry.frame_locator import FrameLocator
from omnisight.visual_odometry.frame_result import FrameResult, LostSegment, TrackedPose
from omnisight.visual_odometry.gyro_prediction import GyroPrediction
from omnisight.visual_odometry.imu import ImuSamples
from omnisight.visual_odometry.initialization import (
    COVERED,
    MIN_CORNERS,
    Initialization,
    WaitingFrame,
    lost_ranges,
    with_points,
)
from omnisight.visual_odometry.keyframe_history import KeyframeHistory
from omnisight.visual_odometry.keyframes import is_keyframe
from omnisight.visual_odometry.loop_closing import close_loops
from omnisight.visual_odometry.loop_result import LoopClosure
from omnisight.visual_odometry.motion_options import MotionOptions
from omnisight.visual_odometry.motion_prediction import MotionPrediction
from omnisight.visual_odometry.pose_estimation import FramePose
from omnisight.visual_odometry.ray_observations import FrameRays
from omnisight.visual_odometry.relocalization import Relocalizer
from omnisight.visual_odometry.rig_scale import estimate_rig_scale
from omnisight.visual_odometry.tracker import Tracker
from omnisight.visual_odometry.window import Keyframe, KeyframeWindow

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Image = NDArray[Any]

INITIALIZING = "waiting for a parallax"
TOO_FEW_POINTS = "too few points of the first two keyframes"


class Odometry:
    """The trajectory of a camera or a rig from its images, frame by frame.

    Patches of the tangent plane are tracked in the images, the pose of each frame follows from the rays of known
    points, and the last keyframes and their points are refined together. Until the camera has moved, and without a
    scale, positions are unknown: the frames before get their poses with the first parallax. The world is the frame of
    the rig at the first frame, and its unit the distance between the first two keyframes.

    Attributes
    ----------
    rig
        The cameras.
    trajectory
        The poses so far, in the order of time.
    lost
        Frames without a pose.
    keyframes
        Number of keyframes so far.
    has_scale
        Whether positions are in metres.
    extrapolated_from
        First frame whose scale is extrapolated, since the rig does not determine it any more; None without.
    residuals
        For each tracked frame the standard deviation of its rays from the points, over the one assumed.
    tracker
        The tracked patches; None before the first image.
    """

    def __init__(
        self,
        camera: Camera | RayCamera | Rig,
        options: MotionOptions = MotionOptions(),
        masks: Sequence[Mask] | None = None,
        imu: ImuSamples | None = None,
    ) -> None:
        """Prepare for images, with masks (H, W) of usable pixels; a gyroscope of any orientation predicts turns."""
        self.rig = central_rig(camera)
        if masks is not None:
            check_sizes(self.rig, masks, "mask")
        self.trajectory: list[TrackedPose] = []
        self.lost: list[LostSegment] = []
        self.keyframes = self._frames = 0
        self.residuals: list[float] = []
        self.has_scale = False
        self.extrapolated_from: int | None = None
        self._options, self._masks = options, masks
        self._motion = MotionPrediction.still(0.0, Pose())
        self.tracker: Tracker | None = None
        self._window: KeyframeWindow | None = None
        self._waiting: Initialization | None = None
        self._relocalizer: Relocalizer | None = None
        self._history: KeyframeHistory | None = None
        self._lost: tuple[int, str] | None = None
        self._speed, self._relocalized = 0.0, -2
        self._locator = FrameLocator(options.seed)
        self._gyro = None if imu is None else GyroPrediction(imu)

    def __repr__(self) -> str:
        return f"Odometry({self._frames} frames, {len(self.trajectory)} poses, {self.keyframes} keyframes)"

    @property
    def points(self) -> Array:
        """The points (P, 3) of the last keyframes in the world."""
        return np.zeros((0, 3)) if self._window is None else self._window.points

    def add(self, image: Image | Sequence[Image], seconds: float) -> FrameResult:
        """Estimate the pose of the next frame.

        Parameters
        ----------
        image
            The image (H, W) or (H, W, 3) of the camera, or those of all cameras of the rig.
        seconds
            Its time, later than that of the frame before.

        Raises
        ------
        ValueError
            If the number or the size of the images differs from the cameras, one is no array, or the time does not
            increase. The frame does not count then.
        """
        frame, tracker = self._track(image, seconds)
        if self._window is None:
            return self._initialize(frame, tracker)
        found = self._locator.locate(frame, is_lost=self._lost is not None)
        if not found:
            reason = found.reason
            frame, found = self._recover(frame, tracker, self._window)
            self._note_loss(frame, reason if found else found.reason)
        if found.rig_from_world is None:
            return replace(self._initialize(frame, tracker), reason=found.reason)
        pose, extends = found.rig_from_world, False
        self._resume(frame, pose)
        tracker.confirm(pose, frame.rays, agrees := found.is_inlier | ~frame.rays.has_point)
        if is_keyframe(self._window, frame.rays[agrees], pose):
            pose, extends = self._extend(frame, tracker, self._window, pose), True
        self._append([TrackedPose(frame.index, seconds, pose)])
        self.residuals.append(found.sigma)
        self._locator.accept(found)
        return FrameResult(frame.index, seconds, pose, self._locator.inliers, extends)

    def skip(self, reason: str) -> None:
        """Count a frame without images, and keep why there are none."""
        if self._lost is None:
            self.lost.append(LostSegment(self._frames, self._frames, reason, "tracking"))
        self._frames += 1

    def finish(self) -> None:
        """End the sequence: frames that still wait for a parallax get the poses of a camera that turns, or none."""
        if self._waiting is not None:
            self._keep_rotations(self._waiting)
            if self._lost is None:
                last = self._waiting.frames[-1]
                self._append([TrackedPose(last.frame, last.seconds, last.pose, "rotation only")])
            self._waiting = None
        self._note_end_of_loss(self._frames, "")
        end = self.trajectory[-1].frame if self.trajectory else -1
        self.lost = [replace(each, recovery="") if each.first > end else each for each in self.lost]

    def close_loops(self) -> LoopClosure:
        """Return the trajectory so far, refined by all keyframes and the places that the camera has seen before.

        Tracking is not changed, and can go on: its world drifts without jumps, and that of the result does not drift.

        Raises
        ------
        ValueError
            If the option `loops` is off.
        """
        if not self._options.loops:
            raise ValueError("keyframes were not kept to close loops: use MotionOptions(loops=True)")
        if self._history is None:
            return LoopClosure(tuple(self.trajectory), reason="there are no images")
        return close_loops(self._history, self.trajectory, has_scale=has_baseline(self.rig))

    def _track(self, image: Image | Sequence[Image], seconds: float) -> tuple[Frame, Tracker]:
        """Track the patches in the next frame."""
        images = gray_images(image)
        check_sizes(self.rig, images, "image")
        check_time(self._frames, seconds, None if self.tracker is None else self._motion.seconds)
        if self.tracker is None:
            self._masks = usable_regions(self.rig, images, self._masks)
            self.tracker = Tracker(self.rig, self._masks, self._options.patches)
            self._history = KeyframeHistory(self.rig, self._masks) if self._options.loops else None
            self._motion = MotionPrediction.still(seconds, Pose())
        index, self._frames = self._frames, self._frames + 1
        predicted = self._motion.at(seconds)
        if self._gyro is not None:
            predicted = self._gyro.turned(predicted, self._motion.rig_from_world, (self._motion.seconds, seconds))
        return Frame(index, seconds, images, predicted, self.tracker.track(images, predicted)), self.tracker

    def _initialize(self, frame: Frame, tracker: Tracker) -> FrameResult:
        """Wait for the first parallax; return the pose of the frame once it is known."""
        waiting = self._waiting
        if waiting is None:
            self._waiting = self._start(frame, tracker, frame.predicted)
            return FrameResult(frame.index, frame.seconds, None, 0, reason=INITIALIZING)
        if waiting.is_sudden(frame.rays):
            frame = self._turned(frame, tracker, waiting.first)
        pose = waiting.turn(frame.rays, frame.predicted, self._options.seed)
        tracker.confirm(pose, frame.rays, np.ones(len(frame.rays), np.bool_))
        waiting.frames.append(WaitingFrame(frame.index, frame.seconds, frame.rays, pose))
        self._follow(frame.seconds, pose)
        window = waiting.solve(self._options.window, RansacOptions(seed=self._options.seed))
        if window is not None:
            return self._begin(frame, tracker, waiting, self._scaled(tracker, waiting, window))
        if waiting.needs_restart():
            self._keep_rotations(waiting)
            self._waiting = self._start(frame, tracker, pose)
        return FrameResult(frame.index, frame.seconds, None, len(frame.rays), reason=INITIALIZING)

    def _turned(self, frame: Frame, tracker: Tracker, first: WaitingFrame) -> Frame:
        """Return the frame with the rays of patches near the rotation that descriptors determine, if they do."""
        masks, seed = self._masks or (), self._options.seed
        turn = rotation_by_descriptors(self.rig, masks, first.images, frame.images, seed)
        if turn is None:
            return frame
        pose = Pose(turn @ first.pose.rotation, turn @ first.pose.translation)
        return replace(frame, predicted=pose, rays=tracker.track_again(pose))

    def _start(self, frame: Frame, tracker: Tracker, pose: Pose) -> Initialization:
        """Return a new initialization that starts with a frame."""
        tracker.start(tracker.corners(frame.images), pose)
        first = WaitingFrame(frame.index, frame.seconds, tracker.rays(pose), pose, frame.images)
        vehicle_from_rig = so3.look(up=self._options.up) if self._options.motion == "car" else None
        return Initialization([first], self._speed, vehicle_from_rig)

    def _keep_rotations(self, waiting: Initialization) -> None:
        """Add the poses of waiting frames to the trajectory if the camera only turned; otherwise they are lost."""
        if waiting.turned_only():
            self._note_end_of_loss(waiting.first.frame, "rotation only")
            self._append(waiting.rotations())
        elif self._lost is None:
            self._lost = waiting.first.frame, waiting.failure

    def _scaled(self, tracker: Tracker, waiting: Initialization, window: KeyframeWindow) -> KeyframeWindow:
        """Return the window in metres if the cameras of a rig determine the scale."""
        if not has_baseline(self.rig):
            return window
        first, last = window.keyframes[0].rig_from_world, window.keyframes[-1].rig_from_world
        rays = with_points(waiting.frames[-1].rays, window)
        distances = np.linalg.norm(last @ rays.points, axis=1)
        found = estimate_rig_scale(rays, tracker.cross_rays(waiting.frames[-1].pose), distances)
        if not found:
            self.extrapolated_from = waiting.first.frame if self.has_scale else None
            self.rig = tracker.rig = at_one_point(self.rig)
            return window
        self.has_scale = True
        relative = last @ first.inverse()
        relative = Pose(relative.rotation, found.scale * relative.translation)
        return waiting.window(relative, self._options.window, has_scale=True)

    def _begin(self, frame: Frame, tracker: Tracker, waiting: Initialization, window: KeyframeWindow) -> FrameResult:
        """Start tracking in a window with the first two keyframes."""
        if self._history is not None and len(self._history):
            self._history.start_segment()
        self._note_end_of_loss(waiting.first.frame, "new segment" if self.trajectory else "tracking")
        self._window, self._waiting, self._relocalizer = window, None, None
        self._locator.restart()
        poses, missing = waiting.trajectory(window, self._options.seed)
        self.lost += [LostSegment(a, b, TOO_FEW_POINTS, "tracking") for a, b in lost_ranges(missing)]
        self._append(poses)
        self.keyframes += 2
        self._store_keyframe(frame, tracker, window, tracker.corners(frame.images))
        return FrameResult(frame.index, frame.seconds, poses[-1].rig_from_world, len(frame.rays), is_keyframe=True)

    def _extend(self, frame: Frame, tracker: Tracker, window: KeyframeWindow, pose: Pose) -> Pose:
        """Add a keyframe to the window, and start new patches; return its refined pose."""
        others = tracker.cross_rays(pose) if has_baseline(self.rig) else FrameRays.none()
        seen = tracker.patches.number[tracker.patches.is_seen]
        corners = in_background(tracker.corners, frame.images)
        window.add(Keyframe(frame.index, pose), tracker.rays(pose), others, seen)
        self._store_keyframe(frame, tracker, window, corners.result())
        self.keyframes += 1
        return window.keyframes[-1].rig_from_world

    def _store_keyframe(self, frame: Frame, tracker: Tracker, window: KeyframeWindow, corners: Sequence[Array]) -> None:
        """Start patches at corners of the last keyframe of a window, and keep it for the closing of loops."""
        tracker.set_points(window.number, window.points)
        window.extend_last(tracker.start(corners, window.keyframes[-1].rig_from_world), frame.images)
        if self._history is not None:
            self._history.update(window, self.rig, self._locator.noise)

    def _recover(self, frame: Frame, tracker: Tracker, window: KeyframeWindow) -> tuple[Frame, FramePose]:
        """Return the frame with the pose that descriptors determine, if there is one."""
        if (corners := tracker.texture(frame.images)) < MIN_CORNERS:
            return frame, FramePose(None, frame.rays.has_point, reason=COVERED.format(corners))
        if self._relocalizer is None:
            self._relocalizer = Relocalizer(self.rig, self._masks or (), window.keyframes)
        pose, reason = self._relocalizer.locate(frame.images, self._options.seed)
        if pose is None:
            return frame, FramePose(None, frame.rays.has_point, reason=reason)
        frame = replace(frame, predicted=pose, rays=tracker.track_again(pose))
        return frame, self._locator.locate(frame, is_lost=True)

    def _resume(self, frame: Frame, pose: Pose) -> None:
        """Continue in the map after a loss; where descriptors determined the pose, the velocity is not known."""
        if self._lost and self._lost[0] == frame.index == self._relocalized + 1:
            self._lost = None  # without a velocity, descriptors determine several poses in a row: no other cut
        if self._lost and self._history:
            self._history.note_loss()
        self._note_end_of_loss(frame.index, "tracking" if self._relocalizer is None else "relocalization")
        if self._relocalizer is not None:
            self._motion, self._relocalized = MotionPrediction.still(frame.seconds, pose), frame.index
        self._waiting, self._relocalizer = None, None

    def _note_loss(self, frame: Frame, reason: str) -> None:
        """Note the first frame of a loss."""
        if self._lost is None:
            self._lost, self._speed = (frame.index, reason), float(np.linalg.norm(self._motion.velocity))

    def _note_end_of_loss(self, frame: int, recovery: str) -> None:
        """Note which frames before this one were lost, or that this one follows a cut."""
        if self._lost is not None and (self._lost[0] < frame or recovery in ("relocalization", "new segment")):
            first, reason = self._lost
            self.lost.append(LostSegment(first, max(first, frame - 1), reason, recovery))
        self._lost = None

    def _append(self, poses: Sequence[TrackedPose]) -> None:
        """Add poses to the trajectory, and follow the motion."""
        for pose in poses:
            if pose.seconds <= self._motion.seconds:
                self._motion = MotionPrediction.still(pose.seconds, pose.rig_from_world)
            else:
                self._follow(pose.seconds, pose.rig_from_world)
        self.trajectory += poses

    def _follow(self, seconds: float, rig_from_world: Pose) -> None:
        """Update the motion by a measured pose."""
        before, self._motion = self._motion, self._motion.after(seconds, rig_from_world)
        if self._gyro is not None:
            turn = so3.log(rig_from_world.rotation @ before.rig_from_world.rotation.T)
            self._gyro.learn((before.seconds, seconds), turn)
