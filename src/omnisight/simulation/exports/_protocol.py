"""The protocol of an export of simulated data sets."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.simulation.dataset import MountedCamera
from omnisight.simulation.image_samples import ImageSample, SampledView
from omnisight.simulation.motion_sensors import MotionMeasurements
from omnisight.simulation.spline_trajectory import SplineTrajectory
from omnisight.simulation.trajectory import Motion

# The path of a file relative to the data set, with "/", and its content, or the file of which it is a hard link.
ExportFile = tuple[str, bytes | Path]


@dataclass(frozen=True)
class SimulatedSequence:
    """A rendered data set.

    Attributes
    ----------
    folder
        Where it is.
    cameras
        The cameras.
    times
        (N,) times of the images, seconds.
    motion
        world_from_rig.
    suffix
        File ending of the images.
    samples
        Samples of the images: all of the first camera, then all of the second camera ...
    measurements
        Of the sensors of the motion.
    """

    folder: Path
    cameras: Sequence[MountedCamera]
    times: NDArray[np.float64]
    motion: Motion
    suffix: str
    samples: Sequence[ImageSample]
    measurements: MotionMeasurements

    def name(self, camera: int, frame: int) -> str:
        """Return the name of an image: its number, after the name of its camera in a rig."""
        own = self.cameras[camera].name
        return f"{own}/{frame:06d}{self.suffix}" if own else f"{frame:06d}{self.suffix}"

    def file(self, camera: int, frame: int) -> Path:
        """Return the file of an image."""
        return self.folder / self.cameras[camera].name / "images" / f"{frame:06d}{self.suffix}"

    def images(self, folder: str) -> Iterator[ExportFile]:
        """Return all images as files of a folder, under their names."""
        for k in range(len(self.cameras)):
            for frame in range(len(self.times)):
                yield f"{folder}/{self.name(k, frame)}", self.file(k, frame)

    def world_from_rig(self, frame: int) -> Pose:
        """Return the pose of the body at an image."""
        return self.motion.at(float(self.times[frame]))

    def view(self, camera: int, frame: int) -> SampledView:
        """Return an image with its pose and its sample."""
        mounted = self.cameras[camera]
        pose = self.world_from_rig(frame) @ mounted.rig_from_camera
        return SampledView(mounted.camera, pose, self.samples[camera * len(self.times) + frame])

    @property
    def spline(self) -> SplineTrajectory:
        """The motion, which is a spline if it is measured by sensors."""
        assert isinstance(self.motion, SplineTrajectory)
        return self.motion


class SequenceExport(Protocol):
    """An export: a module of this folder with these names.

    Attributes
    ----------
    DESCRIPTION
        Section of the README on its files.
    NEEDS_IMU
        Whether it needs an IMU.
    NEEDS_SAMPLES
        Whether it needs samples of the images.
    """

    DESCRIPTION: str
    NEEDS_IMU: bool
    NEEDS_SAMPLES: bool

    def check(self, cameras: Sequence[MountedCamera]) -> None:
        """Check that the format can hold the cameras; raise ValueError with the remedy otherwise."""
        ...

    def files(self, sequence: SimulatedSequence) -> Iterable[ExportFile]:
        """Return the files."""
        ...
