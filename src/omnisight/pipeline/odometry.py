"""Visual odometry of image sequences and clips: the counterpart of `omnisight odometry`."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats import load_rig
from omnisight.images.mask import read_mask
from omnisight.images.output_paths import refuse_overwrite
from omnisight.persistent_interruption import until_interrupted
from omnisight.pipeline.camera_sources import AUTO, AnyCameraSource, CameraSources, RigSource
from omnisight.pipeline.central_camera import camera_of_image
from omnisight.pipeline.frame_sequence import FrameSequence, SequenceFrame
from omnisight.pipeline.odometry_options import OdometryOptions
from omnisight.pipeline.odometry_scale import ScaledTrajectory, ScaleSources
from omnisight.pipeline.trajectory_writer import Format, TrajectoryWriter, replace_trajectory, trajectory_format
from omnisight.rig import Rig
from omnisight.visual_odometry.frame_result import LostSegment, TrackedPose
from omnisight.visual_odometry.loop_result import Loop, LoopClosure
from omnisight.visual_odometry.odometry import Odometry
from omnisight.visual_odometry.scale_estimate import ScaleEstimate
from omnisight.visual_odometry.segments import Segment, trajectory_segments

Progress = Callable[[str, int, int], None]
Watch = Callable[[Odometry, SequenceFrame], None]

# Frames after which the time per frame is measured: the first ones compile and initialize.
START_FRAMES = 5
# Residuals over the noise of tracked patches above which the camera is another one: 1.0 to 1.4 with the true camera of
# five rendered sequences, 4 with a focal length that is 5 % too long, 6 with a centre that is 20 px off.
MAX_RESIDUAL = 3.0


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
        Largest displacement of a pose by the loops, in `unit`.
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
        if not self.residual > MAX_RESIDUAL:
            return *unknown, *self.other_warnings
        text = (
            f"the images contradict the camera: the directions of points differ by {self.residual:.1f} times the noise"
            " of tracked patches. Check that the calibration file is that of this camera, zoom and resolution"
        )
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


def odometry(
    images: str | PathLike[str],
    camera: AnyCameraSource | None = None,
    rig: RigSource | None = None,
    options: OdometryOptions = OdometryOptions(),
    output: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> OdometryResult:
    """Compute the trajectory of a camera or a rig from a clip, a bag or a folder of images.

    Parameters
    ----------
    images
        Folder of images in the order of their names, a video clip, or a ROS bag.
    camera
        The camera or its calibration file; none is needed for 2:1 equirectangular images.
    rig
        The rig or its file, in place of the camera.
    options
        Options of the command.
    output
        Trajectory to write. The first pose replaces an earlier file, and further ones are appended as soon as they
        are known; the file is replaced once loops are closed.
    progress
        Called with the stage, the number of frames done, and of all.

    Returns
    -------
    The result, which is false with a reason if no motion was found.

    Raises
    ------
    ValueError
        If a file cannot be read, the camera is not known, or the images do not have its size.
    """
    report = progress or (lambda stage, done, total: None)
    calibration = camera if rig is None else rig
    rig = rig if rig is None or isinstance(rig, Rig) else load_rig(Path(rig))
    sources = CameraSources.of(camera, rig, None)
    sequence = FrameSequence.open(Path(images), sources.names, options)
    _refuse_inputs(output, [images, calibration, *sequence.paths], options)

    def watch(tracking: Odometry, frame: SequenceFrame) -> None:
        report("tracking", frame.index + 1, max(len(sequence), frame.index + 1))

    result = _run(sequence, _body(sources, sequence, options), options, output, watch, report)
    return replace(result, unit=rig.unit) if rig is not None and result.unit == "m" and not result.scale else result


def live_odometry(
    source: str | int,
    camera: AnyCameraSource,
    options: OdometryOptions = OdometryOptions(),
    output: str | PathLike[str] | None = None,
    watch: Watch = lambda tracking, frame: None,
) -> OdometryResult:
    """Compute the trajectory of a connected camera while it moves; Ctrl-C ends it.

    Frames that arrive while an earlier one is processed are dropped, and counted in the result.

    Parameters
    ----------
    source
        Number of the camera, such as 0; or a clip, which is played at its rate.
    camera
        The calibrated camera or its file.
    options
        Options of the command.
    output
        Trajectory to write, as of `odometry`.
    watch
        Called after each frame with the trajectory so far.

    Raises
    ------
    ValueError
        If the camera cannot be opened or is not calibrated, or the images do not have its size.
    """
    if options.fps is not None or options.topic is not None:
        raise ValueError("--fps and --topic are for files: leave them out with --live")
    sequence = FrameSequence.live(str(source), options)
    _refuse_inputs(output, [source, camera], options)
    body = _body(CameraSources.of(camera, None, None), sequence, options)
    return _run(sequence, body, options, output, watch, lambda stage, done, total: None)


def _run(
    sequence: FrameSequence,
    body: Rig | Camera,
    options: OdometryOptions,
    output: str | PathLike[str] | None,
    watch: Watch,
    report: Progress,
) -> OdometryResult:
    """Track the frames of a sequence, close loops, and determine the scale."""
    start = time.perf_counter()
    known = ScaleSources.of(options, len(sequence.files))
    tracking = Odometry(body, options, _masks(options.mask, body), known.imu)
    path = None if output is None else Path(output)
    with nullcontext() if path is None else TrajectoryWriter.of_path(path, _format(path, options)) as file:
        frames, started = _track(sequence, tracking, known, file, watch)
    elapsed = time.perf_counter() - started
    closed = _close_loops(tracking, options, report)
    scaled = _in_metres(tracking, closed, known)
    # A pipe or a device holds the poses of tracking.
    if (options.loops or scaled.scale) and scaled.poses and path is not None and path.is_file():
        replace_trajectory(path, _format(path, options), scaled.poses, frames)
    fps = (frames - START_FRAMES) / elapsed if frames > START_FRAMES else float("nan")
    return OdometryResult(
        trajectory=scaled.poses,
        frames=frames,
        keyframes=tracking.keyframes,
        lost=tuple(sorted(tracking.lost, key=lambda segment: segment.first)),
        loops=scaled.loops(closed.loops),
        rejected_loops=scaled.loops(closed.rejected),
        correction=closed.correction * scaled.metres,
        unit="m" if scaled.scale or tracking.has_scale else "baselines",
        residual=float(np.median(tracking.residuals)) if tracking.residuals else float("nan"),
        start_seconds=started - start,
        fps=fps,
        scale=scaled.scale,
        other_warnings=(*scaled.warnings, *sequence.warnings(frames)),
        dropped=None if sequence.camera is None else sequence.camera.dropped,
    )


def _track(
    sequence: FrameSequence, tracking: Odometry, known: ScaleSources, file: TrajectoryWriter | None, watch: Watch
) -> tuple[int, float]:
    """Track the frames of a sequence; return their number, and the time at which the first of them were processed."""
    frames, started = 0, time.perf_counter()
    # Ctrl-C is the usual end of a connected camera.
    with nullcontext() if sequence.camera is None else until_interrupted():
        for frame in sequence:
            if frame.images:
                known.observe(tracking.add(frame.images, frame.seconds), tracking)
            else:
                tracking.skip(frame.reason)
            frames += 1
            _write(file, tracking)
            watch(tracking, frame)
            started = time.perf_counter() if frames <= START_FRAMES else started
    tracking.finish()
    _write(file, tracking, frames)
    return frames, started


def _refuse_inputs(output: str | PathLike[str] | None, inputs: Sequence[object], options: OdometryOptions) -> None:
    """Raise ValueError if the trajectory would replace one of the files that are read."""
    files = [*inputs, options.mask, options.wheels, options.imu]
    if output is not None:
        refuse_overwrite([Path(output)], [Path(file) for file in files if isinstance(file, str | PathLike)])


def _body(sources: CameraSources, sequence: FrameSequence, options: OdometryOptions) -> Rig | Camera:
    """Return the calibrated camera or rig of a sequence."""
    if sources.names:
        cameras = [source for source in sources.sources if isinstance(source, Camera)]
        return Rig(tuple(cameras), sources.poses, sources.names)
    if sources.sources[0] == AUTO:
        raise ValueError(
            "odometry needs a calibrated camera: calibrate it (omnisight calibrate), or estimate it from some of the"
            " images (omnisight reconstruct --camera auto), and specify the file (--camera)"
        )
    (source,) = sources.sources
    return camera_of_image(source, sequence.size, sequence.label, name=None, scale=options.scale_camera)


def _masks(path: Path | None, body: Rig | Camera) -> Sequence[NDArray[np.bool_]] | None:
    """Read the masks of the cameras."""
    if path is None:
        return None
    if isinstance(body, Camera):
        return [read_mask(path, body.size)]
    files = [next(iter(sorted(path.glob(f"{name}.*"))), path / f"{name}.png") for name in body.names]
    return [read_mask(file, camera.size) for file, camera in zip(files, body.cameras, strict=True)]


def _close_loops(tracking: Odometry, options: OdometryOptions, report: Progress) -> LoopClosure:
    """Return the trajectory with closed loops, or as it is."""
    if not options.loops:
        return LoopClosure(tuple(tracking.trajectory))
    report("closing loops", 0, 1)
    closed = tracking.close_loops()
    report("closing loops", 1, 1)
    return closed


def _in_metres(tracking: Odometry, closed: LoopClosure, known: ScaleSources) -> ScaledTrajectory:
    """Return the trajectory in metres if something else than the cameras determines the scale."""
    if tracking.has_scale:
        return ScaledTrajectory(closed.trajectory)
    if closed:
        known.correct(tracking.trajectory, closed.trajectory)
    return known.apply(closed.trajectory, tracking.lost, closed.loops)


def _format(path: Path, options: OdometryOptions) -> Format:
    """Return the format of the trajectory."""
    return options.to or trajectory_format(path)


def _write(file: TrajectoryWriter | None, tracking: Odometry, end: int | None = None) -> None:
    """Append the poses that are not in the file yet."""
    if file is not None:
        file.write(tracking.trajectory[file.poses :])
        if end is not None:
            file.skip_to(end)
