"""Visual odometry of image sequences and clips: the counterpart of `omnisight odometry`."""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.formats import load_rig
from omnisight.images.output_paths import refuse_overwrite
from omnisight.persistent_interruption import until_interrupted
from omnisight.pipeline.inputs.camera_sources import AUTO, AnyCameraSource, CameraSources, RigSource
from omnisight.pipeline.inputs.central_camera import camera_of_image
from omnisight.pipeline.inputs.images_of_cameras import read_masks
from omnisight.pipeline.odometry.frame_sequence import FrameSequence, SequenceFrame
from omnisight.pipeline.odometry.odometry_options import OdometryOptions
from omnisight.pipeline.odometry.odometry_result import OdometryResult, TrackingSpeed
from omnisight.pipeline.odometry.odometry_scale import ScaledTrajectory, ScaleSources
from omnisight.pipeline.odometry.trajectory_writer import TrajectoryWriter
from omnisight.progress import Progress, no_progress
from omnisight.rig import Rig
from omnisight.visual_odometry.central_rig import central_rig, has_baseline, largest_baseline
from omnisight.visual_odometry.loop_result import LoopClosure
from omnisight.visual_odometry.odometry import Odometry
from omnisight.visual_odometry.segments import trajectory_segments
from omnisight.visual_odometry.warm_up import warm_up

Watch = Callable[[Odometry, SequenceFrame], None]

# Frames after which the time per frame is measured: the first ones compile and initialize.
START_FRAMES = 5


def odometry(
    images: str | PathLike[str],
    camera: AnyCameraSource | None = None,
    rig: RigSource | None = None,
    options: OdometryOptions = OdometryOptions(),
    output: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
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
    calibration = camera if rig is None else rig
    rig = rig if rig is None or isinstance(rig, Rig) else load_rig(Path(rig))
    sources = CameraSources.of(camera, rig, None, options.name)
    sequence = FrameSequence.open(Path(images), sources.names, options)
    _refuse_inputs(output, [images, calibration, *sequence.paths], options)

    def watch(tracking: Odometry, frame: SequenceFrame) -> None:
        progress("tracking", frame.index + 1, max(len(sequence), frame.index + 1))

    result = _run(sequence, _body(sources, sequence, options), options, output, watch, progress)
    return replace(result, unit=rig.unit) if rig is not None and result.unit == "m" and not result.scale else result


def live_odometry(
    source: str | int,
    camera: AnyCameraSource,
    options: OdometryOptions = OdometryOptions(),
    output: str | PathLike[str] | None = None,
    watch: Watch = lambda tracking, frame: None,
    progress: Progress = no_progress,
) -> OdometryResult:
    """Compute the trajectory of a connected camera while it moves; Ctrl-C ends it.

    The camera is opened to check it, and again after the code is loaded, which takes seconds: frames that arrived
    meanwhile would be lost. Frames that arrive while an earlier one is processed are dropped, and counted in the
    result.

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
    progress
        Called with the stage, the number of its steps done, and of all: before the first frame, and after the last.

    Raises
    ------
    ValueError
        If the camera cannot be opened or is not calibrated, or the images do not have its size.
    """
    if options.fps is not None or options.topic is not None:
        raise ValueError("--fps and --topic are for files: leave them out with --live")
    _refuse_inputs(output, [source, camera], options)
    sources = CameraSources.of(camera, None, None, options.name)
    with closing(FrameSequence.live(str(source), options)) as sequence:
        body = _body(sources, sequence, options)
    if isinstance(body, Camera):
        warm_up(body, options, progress)
    return _run(FrameSequence.live(str(source), options), body, options, output, watch, progress)


def _run(
    sequence: FrameSequence,
    body: Rig | Camera,
    options: OdometryOptions,
    output: str | PathLike[str] | None,
    watch: Watch,
    progress: Progress,
) -> OdometryResult:
    """Track the frames of a sequence, close loops, and determine the scale."""
    start = time.perf_counter()
    known = ScaleSources.of(options, len(sequence.files))
    tracking = Odometry(body, options, _masks(options.mask, body), known.imu)
    file = TrajectoryWriter.of_path(Path(os.devnull if output is None else output), options.to)
    speed = _track(sequence, tracking, known, file, watch, start)
    closed = _close_loops(tracking, options, progress)
    scaled = _in_metres(tracking, closed, known)
    if (options.loops or scaled.scale) and scaled.poses:
        file.replace(scaled.poses, speed.frames)
    result = OdometryResult.of(tracking, closed, scaled, sequence, speed)
    is_known = tracking.has_scale or has_baseline(tracking.rig)
    return replace(result, neglected_baseline=0.0 if is_known else largest_baseline(central_rig(body)))


def _track(
    sequence: FrameSequence,
    tracking: Odometry,
    known: ScaleSources,
    file: TrajectoryWriter,
    watch: Watch,
    start: float,
) -> TrackingSpeed:
    """Track the frames of a sequence, and append their poses to a file; return the speed of a run since its start."""
    frames, started = 0, time.perf_counter()
    with file:
        # Ctrl-C is the usual end of a connected camera.
        with nullcontext() if sequence.camera is None else until_interrupted():
            for frame in sequence:
                if frame.images:
                    known.observe(tracking.add(frame.images, frame.seconds), tracking)
                else:
                    tracking.skip(frame.reason)
                frames += 1
                file.write(tracking.trajectory[file.poses :])
                watch(tracking, frame)
                started = time.perf_counter() if frames <= START_FRAMES else started
        tracking.finish()
        file.write(tracking.trajectory[file.poses :])
        file.skip_to(frames)
    elapsed = time.perf_counter() - started
    fps = (frames - START_FRAMES) / elapsed if frames > START_FRAMES else float("nan")
    return TrackingSpeed(frames, started - start, fps)


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


def _masks(path: Path | None, body: Rig | Camera) -> list[NDArray[np.bool_]]:
    """Read the masks of the cameras; those without one use all pixels."""
    names, cameras = (body.names, body.cameras) if isinstance(body, Rig) else ((), (body,))
    sizes = [camera.size for camera in cameras]
    masks = read_masks(path, names, sizes)
    return [np.ones(size[::-1], np.bool_) if mask is None else mask for mask, size in zip(masks, sizes, strict=True)]


def _close_loops(tracking: Odometry, options: OdometryOptions, progress: Progress) -> LoopClosure:
    """Return the refined trajectory, with closed loops, or the trajectory as it is."""
    if not options.loops:
        return LoopClosure(tuple(tracking.trajectory))
    progress("closing loops", 0, 1)
    closed = tracking.close_loops()
    progress("closing loops", 1, 1)
    return closed


def _in_metres(tracking: Odometry, closed: LoopClosure, known: ScaleSources) -> ScaledTrajectory:
    """Return the trajectory in metres if something else than the cameras determines the scale."""
    if tracking.has_scale and tracking.rig.unit == "m":
        segments = trajectory_segments(closed.trajectory, tracking.lost, closed.loops)
        return ScaledTrajectory.of_rig(closed.trajectory, segments, tracking.extrapolated_from)
    known.correct(tracking.trajectory, closed.trajectory)
    return known.apply(closed.trajectory, tracking.lost, closed.loops)
