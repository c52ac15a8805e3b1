"""A rig: several rigidly connected cameras and their poses."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.extensions import did_you_mean
from omnisight.geometry.pose import Pose
from omnisight.geometry.rays import Rays
from omnisight.geometry.rotation import hat
from omnisight.ray_camera import RayCamera
from omnisight.rig_overlap import overlap, sees

Array = NDArray[np.float64]
Sensor = Camera | RayCamera

MAX_SHOWN = 3  # cameras in the text of a rig
FRAME_ENTRIES = "rig_frame", "frame"  # of the provenance, which name the frame of the rig
ROUNDING = 1e-12  # of the matrix of an identity that a program inverted and wrote


class RelativePose(NamedTuple):
    """Pose of one camera of a rig relative to another one.

    Attributes
    ----------
    pose
        b_from_a.
    covariance
        (6, 6) of the step (w, v) of `Pose.moved`, or None if unknown.
    """

    pose: Pose
    covariance: Array | None


@dataclass(frozen=True, eq=False)
class Rig(Displayed):
    """Cameras, central or not, with their poses on one rigid body.

    Attributes
    ----------
    cameras
        The cameras.
    sensor_from_rig
        For each camera the pose that maps points of the rig frame (x right, y down, z forward) to the camera frame.
    names
        For each camera a unique name: "front", "left" ...
    provenance
        Origin of the rig, such as program and file.
    covariance
        (6 C, 6 C) covariance of the poses of all C cameras, or None if unknown: of the steps (w, v) of `Pose.moved`,
        rotation vector (radians) and translation; zero for the camera that defines the rig frame.
    time_offsets
        For each camera the time (seconds) of its image after the nominal time of the frame; () if unknown.
    unit
        Unit of the translations: "m", "squares" of a board of unknown size, or "units" of a map of unknown scale.
    calibration
        Results of the calibration (rms, images, verdict, ...) by name.
    """

    cameras: tuple[Sensor, ...]
    sensor_from_rig: tuple[Pose, ...]
    names: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    covariance: Array | None = None
    time_offsets: tuple[float, ...] = ()
    unit: str = "m"
    calibration: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        """Check that there are cameras, as many poses and unique names, and the size of the covariance."""
        if not self.cameras:
            raise ValueError("a rig needs at least one camera")
        if not len(self.cameras) == len(self.sensor_from_rig) == len(self.names):
            counts = f"{len(self.cameras)}, {len(self.sensor_from_rig)} and {len(self.names)}"
            raise ValueError(f"a rig needs the same number of cameras, poses and names, got {counts}")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"the camera names of a rig must be unique, got {', '.join(self.names)}")
        size = 6 * len(self.cameras)
        if self.covariance is not None and np.shape(self.covariance) != (size, size):
            shape = np.shape(self.covariance)
            raise ValueError(f"the covariance of a rig of {len(self.cameras)} cameras is ({size}, {size}), got {shape}")
        if self.time_offsets and len(self.time_offsets) != len(self.cameras):
            raise ValueError(f"{len(self.time_offsets)} time offsets for {len(self.cameras)} cameras")

    @classmethod
    def from_sensors(cls, sensors: Mapping[str, tuple[Sensor, Pose]]) -> Self:
        """Make a rig from a mapping of name to camera and `sensor_from_rig`."""
        cameras, poses = tuple(c for c, _ in sensors.values()), tuple(pose for _, pose in sensors.values())
        return cls(cameras, poses, tuple(sensors))

    def __repr__(self) -> str:
        """Summarize the rig, with one camera per line."""
        shown = zip(self.names[:MAX_SHOWN], self.cameras, self.sensor_from_rig, strict=False)
        lines = [
            f"{name}: {camera.model.name}, {camera.width}x{camera.height}, at"
            f" ({', '.join(f'{x:.4g}' for x in np.round(pose.inverse().translation, 9) + 0.0)}) {self.unit}"
            for name, camera, pose in shown
        ]
        more = [f"... {len(self) - MAX_SHOWN} more"] if len(self) > MAX_SHOWN else []
        count = f"{len(self)} camera{'s' if len(self) > 1 else ''}"
        return f"Rig({count}\n    " + "\n    ".join([*lines, *more]) + ")"

    def __hash__(self) -> int:
        return hash((self.cameras, self.sensor_from_rig, self.names))

    def __len__(self) -> int:
        """Return the number of cameras."""
        return len(self.cameras)

    def index(self, sensor: int | str) -> int:
        """Return the index of a camera, given by name or index.

        Raises
        ------
        ValueError
            If there is no such camera.
        """
        if isinstance(sensor, str):
            if sensor not in self.names:
                closest = did_you_mean(sensor, self.names)
                raise ValueError(f"no camera {sensor!r}{closest}; the rig has {', '.join(self.names)}")
            return self.names.index(sensor)
        if not 0 <= sensor < len(self):
            raise ValueError(f"no camera {sensor}; the rig has {len(self)} cameras, numbered from 0")
        return sensor

    def rays(self, sensor: int | str, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (..., 2) of one camera, in the rig frame."""
        k = self.index(sensor)
        origins, bearings, valid = self.cameras[k].rays(pixels)
        rig_from_sensor = self.sensor_from_rig[k].inverse()
        return Rays(rig_from_sensor @ origins, bearings @ rig_from_sensor.rotation.T, valid)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the rig frame into every camera.

        Parameters
        ----------
        points
            (..., 3).

        Returns
        -------
        pixels
            (C, ..., 2) for C cameras, NaN where not valid.
        valid
            (C, ...), whether the point is in the domain of the camera model; `in_view` tests the image.
        """
        pairs = [
            camera.project(pose @ np.asarray(points, float))
            for camera, pose in zip(self.cameras, self.sensor_from_rig, strict=True)
        ]
        return np.stack([pixels for pixels, _ in pairs]), np.stack([valid for _, valid in pairs])

    def in_view(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return (C, ...) which cameras have points (..., 3) in their image and calibrated field of view."""
        at = np.asarray(points, float)
        return np.stack(
            [sees(camera, pose @ at) for camera, pose in zip(self.cameras, self.sensor_from_rig, strict=True)]
        )

    @property
    def reference(self) -> str | None:
        """The camera whose frame is the rig frame, or None."""
        identity = Pose().matrix
        is_identity = [np.allclose(pose.matrix, identity, rtol=0, atol=ROUNDING) for pose in self.sensor_from_rig]
        return self.names[is_identity.index(True)] if any(is_identity) else None

    def with_reference(self, sensor: int | str) -> Self:
        """Return the same rig expressed in the frame of one of its cameras, whose covariance becomes zero.

        The covariance is propagated to first order: sensor_from_ref = sensor_from_rig @ rig_from_ref depends on the
        steps of both poses.
        """
        ref = self.index(sensor)
        rig_from_ref = self.sensor_from_rig[ref].inverse()
        poses = [pose @ rig_from_ref for pose in self.sensor_from_rig]
        poses[ref] = Pose()
        covariance = self.covariance
        if covariance is not None:
            jacobian = _reference_jacobian(poses, self.sensor_from_rig[ref].translation, ref)
            covariance = jacobian @ covariance @ jacobian.T
        return self.in_frame(poses, covariance)

    def in_frame(self, sensor_from_rig: Iterable[Pose], covariance: NDArray[np.float64] | None = None) -> Self:
        """Return the rig with poses in another frame: its provenance does not name the frame of before."""
        provenance = {key: value for key, value in self.provenance.items() if key not in FRAME_ENTRIES}
        return dataclasses.replace(
            self, sensor_from_rig=tuple(sensor_from_rig), covariance=covariance, provenance=provenance
        )

    def relative_pose(self, a: int | str, b: int | str) -> RelativePose:
        """Return b_from_a of two cameras with its covariance."""
        k, seen_from_a = self.index(b), self.with_reference(a)
        covariance = seen_from_a.covariance
        block = None if covariance is None else covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
        return RelativePose(seen_from_a.sensor_from_rig[k], block)

    def sigmas(self, sensor: int | str) -> tuple[float, float] | None:
        """Return the standard deviations of the pose of a camera, or None if the covariance is unknown.

        They are the angle (radians) and the length of the translation: root mean squares of the angle and of the length
        of the error of `sensor_from_rig`.
        """
        if self.covariance is None:
            return None
        variances = np.diagonal(self.covariance)[6 * (k := self.index(sensor)) : 6 * k + 6]
        return float(np.sqrt(variances[:3].sum())), float(np.sqrt(variances[3:].sum()))

    def inverted(self) -> Self:
        """Return the rig whose poses are the inverse: the fix of a file that holds rig_from_sensor as sensor_from_rig.

        Of a file that holds the pose of each camera relative to the preceding one (`provenance["poses"]` is "chain"),
        these are inverted. The covariance is dropped: it belongs to the other poses.
        """
        poses = [pose.inverse() for pose in self.sensor_from_rig]
        if self.provenance.get("poses") == "chain":
            poses = list(self.sensor_from_rig[:1])
            for before, pose in pairwise(self.sensor_from_rig):
                poses.append((pose @ before.inverse()).inverse() @ poses[-1])
        return dataclasses.replace(self, sensor_from_rig=tuple(poses), covariance=None)

    def replaced(self, sensor: int | str, camera: Sensor) -> Self:
        """Return the rig with another camera at the pose of one of its cameras."""
        k = self.index(sensor)
        return dataclasses.replace(self, cameras=(*self.cameras[:k], camera, *self.cameras[k + 1 :]))

    def overlap(self, distance: float = float("inf")) -> Array:
        """Return (C, C) the share of the field of view of camera i (row) that camera j (column) sees at a distance.

        Bearings are sampled uniformly on the sphere around camera i; `distance` is in the unit of the rig.
        """
        return overlap(self.cameras, self.sensor_from_rig, distance)

    def scaled(self, factor: float) -> Self:
        """Return the rig for images resized by a factor."""
        return dataclasses.replace(self, cameras=tuple(camera.scaled(factor) for camera in self.cameras))

    def subset(self, sensors: Sequence[int | str]) -> Self:
        """Return a rig of some of the cameras."""
        chosen = [self.index(sensor) for sensor in sensors]
        rows = np.concatenate([np.arange(6) + 6 * k for k in chosen])
        return dataclasses.replace(
            self,
            cameras=tuple(self.cameras[k] for k in chosen),
            sensor_from_rig=tuple(self.sensor_from_rig[k] for k in chosen),
            names=tuple(self.names[k] for k in chosen),
            covariance=None if self.covariance is None else self.covariance[np.ix_(rows, rows)],
            time_offsets=tuple(self.time_offsets[k] for k in chosen) if self.time_offsets else (),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Rig):
            return NotImplemented
        # The default comparison of dataclasses fails for arrays.
        return all(
            np.array_equal(ours, theirs) if isinstance(ours, np.ndarray) else ours == theirs
            for field in dataclasses.fields(self)
            for ours, theirs in [(getattr(self, field.name), getattr(other, field.name))]
        )


def _reference_jacobian(poses: Sequence[Pose], translation: Array, ref: int) -> Array:
    """Return the derivative of the steps of sensor_from_ref by those of sensor_from_rig.

    With R, t of sensor_from_ref and the translation t_ref of ref_from_rig: w' = w - R w_ref and
    v' = v - R v_ref + [R t_ref]x w'.
    """
    jacobian = np.eye(6 * len(poses))
    for k, pose in enumerate(poses):
        rows, lever = slice(6 * k, 6 * k + 6), hat(pose.rotation @ translation)
        own = np.block([[np.eye(3), np.zeros((3, 3))], [lever, np.eye(3)]])
        turn = np.block([[pose.rotation, np.zeros((3, 3))], [np.zeros((3, 3)), pose.rotation]])
        jacobian[rows, rows] = own
        jacobian[rows, 6 * ref : 6 * ref + 6] -= own @ turn
    return jacobian
