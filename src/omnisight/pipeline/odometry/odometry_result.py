"""The result of visual odometry."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from omnisight.display import Displayed
from omnisight.pipeline.odometry.frame_sequence import FrameSequence
from omnisight.pipeline.odometry.odometry_scale import ScaledTrajectory
from omnisight.visual_odometry.frame_result import LostSegment, TrackedPose
from omnisight.visual_odometry.loop_result import Loop, LoopClosure
from omnisight.visual_odometry.odometry import Odometry
from omnisight.visual_odometry.scale_estimate import ScaleEstimate
from omnisight.visual_odometry.segments import Segment, trajectory_segments

# Residuals over the noise of tracked patches above which the camera is another one: 0.8 to 1.9 with the true camera of
# eight rendered sequences, up to 6.5 with a focal length that is 5 % too long or a centre that is 20 px off.
MAX_RESIDUAL = 3.0


class TrackingSpeed(NamedTuple):
    """The number of tracked frames, seconds until the first of them were processed, and frames per second since."""

    frames: int
    start_seconds: float
    fps: float


@dataclass(frozen=True, eq=False)
class OdometryResult(Displayed):
    """The trajectory of a sequence; false if there is none.

    Attributes
    ----------
    trajectory
        The poses that are known, in the order of time.
    frames
        Number of frames.
    keyframes
        Number of keyframes.
    lost
        Frames without a pose, with reasons.
    loops
        The closed loops.
    rejected_loops
        Places that look alike, whose poses contradict the trajectory or the other loops.
    correction
        Largest displacement of a pose by the loops and the refinement at the end, in `unit`.
    unit
        Unit of positions: "m" or, of a rig that was calibrated with a board of unknown size, "squares"; "baselines" of
        the first two keyframes if the scale is unknown.
    residual
        Median standard deviation of the rays from the points, over that of tracked patches; NaN without any.
    start_seconds
        Time until the first frames were processed, with the start of compiled code.
    fps
        Frames per second after the start, with reading them.
    scale
        Metres per baseline, or why it is unknown; None without any measurement besides the images.
    other_warnings
        Scales that contradict each other, segments whose scale is extrapolated, and a clip that ends early.
    dropped
        Number of frames of a connected camera that arrived while an earlier one was processed; None for files.
    neglected_baseline
        Largest distance between the cameras of a rig, in its unit, if they were taken to be in one point because the
        first keyframes did not determine the scale; otherwise 0.
    """

    trajectory: tuple[TrackedPose, ...] = field(repr=False)
    frames: int
    keyframes: int
    lost: tuple[LostSegment, ...]
    loops: tuple[Loop, ...] = field(repr=False)
    rejected_loops: tuple[Loop, ...] = field(repr=False)
    correction: float
    unit: str
    residual: float
    start_seconds: float
    fps: float
    scale: ScaleEstimate | None = None
    other_warnings: tuple[str, ...] = ()
    dropped: int | None = None
    neglected_baseline: float = 0.0

    @classmethod
    def of(
        cls,
        tracking: Odometry,
        closed: LoopClosure,
        scaled: ScaledTrajectory,
        sequence: FrameSequence,
        speed: TrackingSpeed,
    ) -> Self:
        """Return the result of a sequence that was tracked, whose loops were closed, and whose scale was determined."""
        return cls(
            trajectory=scaled.poses,
            frames=speed.frames,
            keyframes=tracking.keyframes,
            lost=tuple(sorted(tracking.lost, key=lambda segment: segment.first)),
            loops=scaled.loops(closed.loops),
            rejected_loops=scaled.loops(closed.rejected),
            correction=closed.correction * scaled.metres,
            unit="m" if scaled.scale or tracking.has_scale else "baselines",
            residual=float(np.median(tracking.residuals)) if tracking.residuals else float("nan"),
            start_seconds=speed.start_seconds,
            fps=speed.fps,
            scale=scaled.scale,
            other_warnings=(*scaled.warnings, *sequence.warnings(speed.frames)),
            dropped=None if sequence.camera is None else sequence.camera.dropped,
        )

    def __bool__(self) -> bool:
        """Return whether there are poses of a camera that moves."""
        return any(pose.motion == "general" for pose in self.trajectory)

    @cached_property
    def segments(self) -> tuple[Segment, ...]:
        """The parts of the trajectory between losses that no known place ended; loops can join their worlds."""
        return trajectory_segments(self.trajectory, self.lost, self.loops)

    @cached_property
    def path_length(self) -> float:
        """Length of the path, in `unit`."""
        centers = np.array([pose.rig_from_world.inverse().translation for pose in self.trajectory]).reshape(-1, 3)
        return float(np.linalg.norm(np.diff(centers, axis=0), axis=1).sum())

    @property
    def has_scale(self) -> bool:
        """Whether positions are in metres."""
        return self.unit == "m"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that measurements contradict each other, or the images the camera."""
        unknown = (self.scale.reason,) if self.scale is not None and not self.scale and self else ()
        residual = f"the directions of points differ by {self.residual:.1f} times the noise of tracked patches"
        if self.neglected_baseline:
            measured = "" if np.isnan(self.residual) else f" ({residual})"
            text = (
                f"the cameras of the rig, up to {self.neglected_baseline:.3g} units of its file apart, were taken to be"
                " in one point, because too few points of the first keyframes were found in two of them: near points"
                f" make the poses inaccurate{measured}. Track one of the cameras (--camera rig.json --name)"
            )
        elif self.residual > MAX_RESIDUAL:
            text = (
                f"the images contradict the camera: {residual}. Check that the calibration file is that of this camera,"
                " zoom and resolution"
            )
        else:
            return *unknown, *self.other_warnings
        return text, *unknown, *self.other_warnings

    @property
    def reason(self) -> str:
        """Why there is no trajectory; empty if there is one."""
        if self:
            return ""
        if self.trajectory:
            return "the camera only turned, or did not move: no position is known"
        if self.frames < 2:
            return "one image shows no motion: specify a clip, or a folder of two or more"
        return self.lost[0].reason if self.lost else "there are no frames"
