"""Check a recording before it is used, or the installation: the counterpart of `omnisight doctor`."""

import itertools
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.diagnosis import installation_checks, recording_checks
from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import RUN, Recording
from omnisight.display import Displayed, shortened
from omnisight.images import to_gray8
from omnisight.images.mask import read_mask
from omnisight.pipeline.inputs.camera_sources import AnyCameraSource, CameraSources
from omnisight.pipeline.inputs.central_camera import camera_of_image
from omnisight.pipeline.odometry.doctor_options import DoctorOptions
from omnisight.pipeline.odometry.frame_sequence import DEFAULT_FPS, FrameSequence
from omnisight.progress import Progress, no_progress


@dataclass(frozen=True, eq=False)
class Diagnosis(Displayed):
    """The findings of all checks; true if none has failed.

    Attributes
    ----------
    findings
        One for each check.
    static_region
        (H, W) pixels that look the same in all images; None if unknown, or for the installation.
    """

    findings: tuple[Finding, ...]
    static_region: NDArray[np.bool_] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Return the worst level, and which checks are not OK."""
        found = [f"{finding.level}: {finding.name}" for finding in self.findings if finding.level > Level.OK]
        return shortened(f"Diagnosis({', '.join([f'{self.level}, {len(self.findings)} checks', *found])})")

    def __bool__(self) -> bool:
        return self.level < Level.FAILED

    @property
    def level(self) -> Level:
        """The worst level of all findings."""
        return max(finding.level for finding in self.findings)


def doctor(
    images: str | PathLike[str] | None = None,
    camera: AnyCameraSource | None = None,
    options: DoctorOptions = DoctorOptions(),
    progress: Progress = no_progress,
) -> Diagnosis:
    """Check a clip or a folder of images of a moving camera, or, without images, the installation.

    Parameters
    ----------
    images
        Video clip, or folder of images in the order of their names; None for the installation.
    camera
        The camera or its calibration file; none is needed for 2:1 equirectangular images.
    options
        Options of the command.
    progress
        Called with the stage, the number of images done, and of all.

    Raises
    ------
    ValueError
        If there are no images, there is a camera without images, or the camera file or the mask cannot be read.
    """
    if images is None and camera is not None:
        raise ValueError("the camera applies to a recording: specify a clip or a folder of images with it")
    if images is None:
        return Diagnosis(tuple(check() for check in installation_checks.all_checks()))
    sequence = FrameSequence.open(Path(images), (), options)
    recording = _examine(sequence, camera, options, progress)
    findings = tuple(check(recording) for check in recording_checks.all_checks())
    return Diagnosis(findings, recording.static_region)


def _examine(
    sequence: FrameSequence, source: AnyCameraSource | None, options: DoctorOptions, progress: Progress
) -> Recording:
    """Measure runs of consecutive images, distributed over a sequence."""
    camera, reason = _camera(source, sequence, options)
    mask = None if options.mask is None else read_mask(options.mask, sequence.size)
    recording = Recording(camera, reason, mask)
    chosen = _spread(len(sequence), options.images)
    for done, frame in enumerate(sequence.frames(chosen), 1):
        if frame.images:
            recording.add(frame.index, frame.seconds, to_gray8(frame.images[0]))
        else:
            recording.unreadable.append(frame.reason)
        progress("images", done, max(len(chosen), done))
    # A truncated clip has none of the images that are chosen after its end.
    if recording.frames and recording.frames[-1].index < chosen[-1]:
        recording.unreadable.extend(sequence.warnings(recording.frames[-1].index + 1))
    recording.times, recording.times_from = _times(sequence, recording, options)
    return recording


def _camera(
    source: AnyCameraSource | None, sequence: FrameSequence, options: DoctorOptions
) -> tuple[Camera | None, str]:
    """Return the camera of a sequence, or None with the reason."""
    (found,) = CameraSources.of(source, None, None, options.name).sources
    try:
        return camera_of_image(found, sequence.size, sequence.label, name=None, scale=options.scale_camera), ""
    except ValueError as error:
        return None, str(error)


def _spread(count: int, wanted: int) -> range | list[int]:
    """Return indices of runs of consecutive images, evenly distributed over a sequence; of all if it is short."""
    runs = max(wanted // RUN, 2)
    if count <= max(wanted, runs * RUN):
        return range(count or wanted)
    starts = np.linspace(0, count - RUN, runs).astype(int)
    return [int(start) + k for start in starts for k in range(RUN)]


def _times(sequence: FrameSequence, recording: Recording, options: DoctorOptions) -> tuple[NDArray[np.float64], str]:
    """Return the times of the images (N,), and where they are from."""
    if not sequence.files:
        frames = recording.frames
        steps = [b.seconds - a.seconds for a, b in itertools.pairwise(frames) if b.index == a.index + 1]
        return np.concatenate([[0.0], np.cumsum(steps)]), f"times of the {'clip' if sequence.stream is None else 'bag'}"
    if sequence.times_file is not None:
        return np.array(sequence.times), f"times of {sequence.times_file.name}"
    fps = "--fps" if options.fps is not None else f"assumed: specify --fps if it is not {DEFAULT_FPS:g}"
    return np.array(sequence.times), fps
