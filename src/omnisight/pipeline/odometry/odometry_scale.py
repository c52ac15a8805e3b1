"""The scale of a trajectory from measurements besides the images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.pipeline.odometry.motion_files import read_imu, read_wheels
from omnisight.pipeline.odometry.odometry_options import OdometryOptions
from omnisight.targets.length import parse_length
from omnisight.visual_odometry.frame_result import FrameResult, LostSegment, TrackedPose
from omnisight.visual_odometry.ground_plane import GroundHeight, ground_height, scale_from_height
from omnisight.visual_odometry.imu import ImuSamples
from omnisight.visual_odometry.imu_scale import scale_from_imu
from omnisight.visual_odometry.loop_result import Loop
from omnisight.visual_odometry.odometry import Odometry
from omnisight.visual_odometry.scale_estimate import ScaleEstimate
from omnisight.visual_odometry.segments import Segment, trajectory_segments
from omnisight.visual_odometry.wheel_scale import WheelSpeeds, scale_from_wheels

Array = NDArray[np.float64]

# Uncertainty (metres, one standard deviation) of the end points of a distance that a person measures.
DISTANCE_SIGMA_M = 0.01
# Frames before and after a keyframe whose path determines the change of the scale by closed loops.
HALF_WINDOW = 10
# Difference of two scales, over its standard deviation, at which one of them is wrong.
MAX_DIFFERENCE_SIGMA = 4.0

EXTRAPOLATED = "the scale of {} of {} segments is extrapolated"


@dataclass(frozen=True)
class ScaledTrajectory:
    """A trajectory in metres, if the scale is known.

    Attributes
    ----------
    poses
        All poses.
    scale
        The scale of the first segment of the trajectory; None if nothing is known besides the images.
    warnings
        Contradictions, and segments of unknown scale.
    metres_of_frame
        Metres per unit of the trajectory before, of each frame; none if it was in metres, or the scale is unknown.
    """

    poses: tuple[TrackedPose, ...]
    scale: ScaleEstimate | None = None
    warnings: tuple[str, ...] = ()
    metres_of_frame: Mapping[int, float] = field(default_factory=dict[int, float])

    @classmethod
    def of_rig(cls, poses: Sequence[TrackedPose], segments: Sequence[Segment], extrapolated_from: int | None) -> Self:
        """Return a trajectory that a rig determined in metres, except for segments from a frame on."""
        worlds = {part.world for part in segments}
        known = {part.world for part in segments if extrapolated_from is None or part.first < extrapolated_from}
        if worlds == known:
            return cls(tuple(poses))
        which = EXTRAPOLATED.format(len(worlds - known), len(worlds))
        text = f"{which}: the cameras of the rig do not determine it from image {extrapolated_from} on"
        return cls(tuple(poses), warnings=(text,))

    @property
    def metres(self) -> float:
        """Metres per unit of the trajectory before, of its first segment."""
        return self.scale.metres if self.scale else 1.0

    def loops(self, loops: Sequence[Loop]) -> tuple[Loop, ...]:
        """Return loops of the trajectory before in the unit of this one."""
        scales = [self.metres_of_frame.get(loop.first, 1.0) for loop in loops]
        poses = [loop.first_from_last for loop in loops]
        moved = [Pose(p.rotation, metres * p.translation) for p, metres in zip(poses, scales, strict=True)]
        return tuple(replace(loop, first_from_last=pose) for loop, pose in zip(loops, moved, strict=True))


@dataclass(frozen=True, eq=False)
class WorldInMetres:
    """The world of a segment in metres: x_metres = metres * x + shift.

    Attributes
    ----------
    metres
        Per unit.
    shift
        (3,) metres.
    """

    metres: float
    shift: Array

    @classmethod
    def starting(cls, first: TrackedPose, metres: float, before: Sequence[TrackedPose]) -> Self:
        """Return the world in which the first pose of a segment is where the poses before end."""
        if not before:
            return cls(metres, np.zeros(3))
        return cls(metres, _position(before[-1]) - metres * _position(first))

    def __matmul__(self, pose: TrackedPose) -> TrackedPose:
        """Return a pose in metres."""
        rotation = pose.rig_from_world.rotation
        position = self.metres * _position(pose) + self.shift
        return replace(pose, rig_from_world=Pose(rotation, -rotation @ position))


@dataclass(eq=False)
class ScaleSources:
    """What is known about the scale.

    Attributes
    ----------
    height
        Of the camera over the ground, metres.
    wheels, imu
        Measurements.
    distance
        Two frames and their distance, metres.
    """

    height: float | None
    down: tuple[float, float, float]
    wheels: WheelSpeeds | None
    imu: ImuSamples | None
    distance: tuple[int, int, float] | None
    _heights: list[GroundHeight] = field(default_factory=list[GroundHeight], repr=False)

    @classmethod
    def of(cls, options: OdometryOptions, images: int = 0) -> Self:
        """Read the files of the options, given the number of images, 0 if unknown.

        Raises
        ------
        ValueError
            If a file cannot be read, a length has no unit, or there is no image of a number.
        """
        x, y, z = (look(up=options.up).T @ np.array([0.0, 1.0, 0.0])).tolist()
        pair = options.distance
        if pair is not None and (pair[0] == pair[1] or not all(0 <= n < (images or np.inf) for n in pair[:2])):
            numbers = f"0 to {images - 1}" if images else "from 0"
            raise ValueError(f"--distance {' '.join(map(str, pair))}: specify two images by their numbers, {numbers}")
        return cls(
            None if options.height is None else parse_length(options.height, "--height"),
            (x, y, z),
            None if options.wheels is None else read_wheels(options.wheels),
            None if options.imu is None else read_imu(options.imu),
            None if pair is None else (pair[0], pair[1], parse_length(pair[2], "--distance")),
        )

    def observe(self, result: FrameResult, tracking: Odometry) -> None:
        """Look for the ground below a keyframe, if the height is known."""
        if self.height is None or not result.is_keyframe or result.rig_from_world is None:
            return
        found = ground_height(result.frame, tracking.points, result.rig_from_world, np.array(self.down))
        if found is not None:
            self._heights.append(found)

    def correct(self, tracked: Sequence[TrackedPose], closed: Sequence[TrackedPose]) -> None:
        """Convert heights of the ground to the unit of a refined trajectory, in which scales differ."""
        before, after = (
            np.array([pose.rig_from_world.inverse().translation for pose in poses]) for poses in (tracked, closed)
        )
        row = {pose.frame: k for k, pose in enumerate(tracked)}
        for k, ground in enumerate(self._heights):
            at = slice(max(row[ground.frame] - HALF_WINDOW, 0), row[ground.frame] + HALF_WINDOW)
            lengths = [np.linalg.norm(np.diff(path[at], axis=0), axis=1).sum() for path in (before, after)]
            if lengths[0] > 0:
                self._heights[k] = replace(ground, height=ground.height * float(lengths[1] / lengths[0]))

    def apply(
        self, poses: Sequence[TrackedPose], lost: Sequence[LostSegment], loops: Sequence[Loop] = ()
    ) -> ScaledTrajectory:
        """Return a trajectory in metres if the scale of one of its segments is known.

        Segments that loops join have one scale, and keep their relative poses.
        """
        segments = trajectory_segments(poses, lost, loops)
        parts = [[pose for pose in poses if part.first <= pose.frame <= part.last] for part in segments]
        found, worlds = [self.estimates(part) for part in parts], [part.world for part in segments]
        best = dict[int, ScaleEstimate]()  # by world
        for world, estimate in ((w, each) for w, of_part in zip(worlds, found, strict=True) for each in of_part):
            if estimate and (world not in best or estimate.relative_sigma < best[world].relative_sigma):
                best[world] = estimate
        if not best:
            reasons = "; ".join(each.reason for each in (found[0] if found else ()))
            return ScaledTrajectory(tuple(poses), ScaleEstimate("", reason=reasons) if reasons else None)
        warnings = [text for of_part in found for text in _contradictions(of_part)]
        if set(worlds) > set(best):
            warnings.append(EXTRAPOLATED.format(len(set(worlds) - set(best)), len(set(worlds))))
        first = last = next(best[world] for world in worlds if world in best)
        frames, scaled = dict[int, WorldInMetres](), list[TrackedPose]()
        for world, part in zip(worlds, parts, strict=True):
            if world not in frames:
                last = best.get(world, last)
                frames[world] = WorldInMetres.starting(part[0], last.metres, scaled)
            scaled += [frames[world] @ pose for pose in part]
        metres = {pose.frame: frames[w].metres for w, part in zip(worlds, parts, strict=True) for pose in part}
        return ScaledTrajectory(tuple(scaled), first, tuple(warnings), metres)

    def estimates(self, poses: Sequence[TrackedPose]) -> list[ScaleEstimate]:
        """Return the scale of one segment from each source."""
        times = np.array([pose.seconds for pose in poses])
        world_from_rig = [pose.rig_from_world.inverse() for pose in poses]
        centers = np.array([pose.translation for pose in world_from_rig]).reshape(-1, 3)
        found = list[ScaleEstimate]()
        if self.wheels is not None:
            found.append(scale_from_wheels(times, centers, self.wheels))
        if self.height is not None:
            frames = {pose.frame for pose in poses}
            found.append(scale_from_height([each for each in self._heights if each.frame in frames], self.height))
        if self.imu is not None:
            found.append(scale_from_imu(times, world_from_rig, self.imu))
        if self.distance is not None:
            found.append(_scale_from_distance(poses, *self.distance))
        return found


def _scale_from_distance(poses: Sequence[TrackedPose], first: int, last: int, metres: float) -> ScaleEstimate:
    """Return the scale by the distance of two frames."""
    by_frame = {pose.frame: pose.rig_from_world.inverse().translation for pose in poses}
    missing = [frame for frame in (first, last) if frame not in by_frame]
    source = f"the distance of images {first} and {last}"
    if missing:
        return ScaleEstimate(source, reason=f"image {missing[0]} has no pose in this segment")
    length = float(np.linalg.norm(by_frame[last] - by_frame[first]))
    if not length > 0:
        return ScaleEstimate(source, reason=f"images {first} and {last} have the same position")
    return ScaleEstimate.checked(source, metres / length, DISTANCE_SIGMA_M / metres)


def _position(pose: TrackedPose) -> Array:
    return pose.rig_from_world.inverse().translation


def _contradictions(found: Sequence[ScaleEstimate]) -> list[str]:
    """Return sentences on scales that differ by more than their uncertainty."""
    known = [each for each in found if each]
    texts = list[str]()
    for k, a in enumerate(known):
        for b in known[k + 1 :]:
            difference = abs(np.log(a.metres / b.metres))
            if difference > MAX_DIFFERENCE_SIGMA * np.hypot(a.relative_sigma, b.relative_sigma):
                texts.append(
                    f"the scale from {a.source} differs by {np.expm1(difference):.1%} from that of {b.source}: one of"
                    " them is wrong"
                )
    return texts
