"""Several cameras on one body, and where each stands on it."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rays import Rays
from omnisight.ray_camera import RayCamera

Array = NDArray[np.float64]
Sensor = Camera | RayCamera


@dataclass(frozen=True)
class Rig:
    """Cameras, central or not, with their places on one body.

    Attributes
    ----------
    cameras
        The cameras.
    sensor_from_rig
        For each the pose that maps points of the rig's frame (x right, y down, z forward) into its own.
    names
        One for each: "front", "left" ...
    provenance
        Where it came from.
    """

    cameras: tuple[Sensor, ...]
    sensor_from_rig: tuple[Pose, ...]
    names: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        """Refuse what does not fit together."""
        if not self.cameras:
            raise ValueError("a rig needs a camera, got none")
        if not len(self.cameras) == len(self.sensor_from_rig) == len(self.names):
            counts = f"{len(self.cameras)}, {len(self.sensor_from_rig)} and {len(self.names)}"
            raise ValueError(f"a rig needs as many cameras as poses and names, got {counts}")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"the names of a rig's cameras must differ, got {', '.join(self.names)}")

    @classmethod
    def of(cls, sensors: Mapping[str, tuple[Sensor, Pose]]) -> Self:
        """Make it from cameras and their `sensor_from_rig`, by name."""
        cameras, poses = tuple(c for c, _ in sensors.values()), tuple(pose for _, pose in sensors.values())
        return cls(cameras, poses, tuple(sensors))

    def __len__(self) -> int:
        """Give the number of cameras."""
        return len(self.cameras)

    def index(self, sensor: int | str) -> int:
        """Give the place of a camera in `cameras`, by its name or its place.

        Raises
        ------
        ValueError
            If there is no such camera.
        """
        if isinstance(sensor, str):
            if sensor not in self.names:
                raise ValueError(f"no camera {sensor!r}; the rig has {', '.join(self.names)}")
            return self.names.index(sensor)
        if not 0 <= sensor < len(self):
            raise ValueError(f"no camera {sensor}; the rig has {len(self)}, counted from 0")
        return sensor

    def rays(self, sensor: int | str, pixels: ArrayLike) -> Rays:
        """Give the rays of pixels (..., 2) of one camera, in the rig's frame."""
        k = self.index(sensor)
        origins, bearings, valid = self.cameras[k].rays(pixels)
        rig_from_sensor = self.sensor_from_rig[k].inverse()
        return Rays(rig_from_sensor @ origins, bearings @ rig_from_sensor.rotation.T, valid)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the rig's frame into every camera.

        Parameters
        ----------
        points
            (..., 3).

        Returns
        -------
        pixels
            (C, ..., 2) for C cameras, NaN where not valid.
        valid
            (C, ...), whether the point lies inside the camera's domain; see `sees` for its image.
        """
        pairs = [
            camera.project(pose @ np.asarray(points, float))
            for camera, pose in zip(self.cameras, self.sensor_from_rig, strict=True)
        ]
        return np.stack([pixels for pixels, _ in pairs]), np.stack([valid for _, valid in pairs])

    def sees(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Say which cameras see points (..., 3): (C, ...); in their image, and in their calibrated cone if known."""
        at = np.asarray(points, float)
        pixels, valid = self.project(at)
        shown = [camera.in_image(own) for camera, own in zip(self.cameras, pixels, strict=True)]
        inside = [_inside(camera, pose @ at) for camera, pose in zip(self.cameras, self.sensor_from_rig, strict=True)]
        return valid & np.stack(shown) & np.stack(inside)

    def scaled(self, factor: float) -> Self:
        """Give the rig of images resized by a factor."""
        return dataclasses.replace(self, cameras=tuple(camera.scaled(factor) for camera in self.cameras))

    def part(self, sensors: Sequence[int | str]) -> Self:
        """Give some of its cameras."""
        some = [self.index(sensor) for sensor in sensors]
        return dataclasses.replace(
            self,
            cameras=tuple(self.cameras[k] for k in some),
            sensor_from_rig=tuple(self.sensor_from_rig[k] for k in some),
            names=tuple(self.names[k] for k in some),
        )


def _inside(camera: Sensor, points: Array) -> NDArray[np.bool_]:
    """Say which points of its frame lie in a camera's calibrated cone."""
    angle = np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2])
    return (angle >= camera.theta_min) & (angle <= (np.pi if camera.theta_max is None else camera.theta_max))
