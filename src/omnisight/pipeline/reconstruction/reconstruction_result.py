"""The result of structure from motion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.images import unreadable_warnings
from omnisight.sfm.calibration_check import FocalLengthChange
from omnisight.sfm.georeference import Georeference
from omnisight.sfm.reconstruction import Reconstruction


@dataclass(frozen=True, eq=False)
class ExtrinsicsChange(Displayed):
    """How far a refined pose of a camera on its rig is from that of the file.

    Attributes
    ----------
    camera
        Name of the camera.
    distance, angle
        Length of the difference of `sensor_from_rig` in the unit of the rig, and angle, radians.
    distance_sigma, angle_sigma
        Standard deviations of the refined pose, see `Rig.sigmas`; NaN if it is not determined.
    """

    camera: str
    distance: float
    angle: float
    distance_sigma: float
    angle_sigma: float


@dataclass(frozen=True, eq=False)
class ReconstructionResult(Displayed):
    """The models of a set of images; false if there is none.

    Attributes
    ----------
    models
        One for each group of images that are connected by common points, the largest first.
    images
        Number of images.
    unregistered
        Names of the images that are in no model, with the reason.
    unreadable
        Names of those of them that cannot be read.
    seconds
        Time of the whole computation.
    peak_memory_bytes
        Largest memory of the process so far; None if the system does not report it.
    reason
        Why there is no model; empty otherwise.
    simultaneous
        For a rig, what images that were taken together have in common: "name", "number" or "order".
    self_calibrated
        Names of the cameras that were estimated from the images; their covariance is in the rigs of the models.
    focal_length_changes
        Focal lengths that the largest model contradicts significantly, by the names of the cameras: these calibrations
        may belong to other images.
    georeferences
        How each model was scaled or brought to known positions; none if there are no measurements in metres.
    other_warnings
        Known positions that are not used.
    known_poses
        Poses `sensor_from_rig` of a rig file if they were refined; none otherwise.
    """

    models: tuple[Reconstruction, ...]
    images: int
    unregistered: dict[str, str] = field(repr=False)
    unreadable: tuple[str, ...] = field(repr=False)
    seconds: float
    peak_memory_bytes: int | None = None
    reason: str = ""
    simultaneous: str = ""
    self_calibrated: tuple[str, ...] = ()
    focal_length_changes: Mapping[str, FocalLengthChange] = field(default_factory=dict[str, FocalLengthChange])
    georeferences: tuple[Georeference, ...] = ()
    other_warnings: tuple[str, ...] = ()
    known_poses: tuple[Pose, ...] = ()

    def __bool__(self) -> bool:
        """Return whether there is a model."""
        return bool(self.models)

    @property
    def extrinsics_changes(self) -> tuple[ExtrinsicsChange, ...]:
        """How far the refined poses of the cameras that the models show are from those of the rig file."""
        changes, shown = list[ExtrinsicsChange](), {k for model in self.models for k in model.sensor.tolist()}
        for k, known in enumerate(self.known_poses):
            if k and k in shown:
                rig = self.models[0].rig
                step = known.step_to(rig.sensor_from_rig[k])
                angle, distance = (float(np.linalg.norm(part)) for part in (step[:3], step[3:]))
                angle_sigma, distance_sigma = rig.sigmas(k) or (np.nan, np.nan)
                changes.append(ExtrinsicsChange(rig.names[k], distance, angle, distance_sigma, angle_sigma))
        return tuple(changes)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that images cannot be read, or known positions are not used."""
        unreadable = unreadable_warnings({name: self.unregistered[name] for name in self.unreadable}, self.images)
        return *unreadable, *self.other_warnings
