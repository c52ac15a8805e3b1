"""The cameras that a user specifies for a set of images: one, several by name, or a rig."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Literal, Self

import numpy as np

from omnisight.camera import Camera
from omnisight.formats import load, load_rig
from omnisight.geometry.pose import Pose
from omnisight.optics.catadioptric import Catadioptric
from omnisight.pipeline.inputs.central_camera import AnyCameraSource, CameraSource, load_sensor
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig

RigSource = Rig | str | PathLike[str]
# The name in place of a calibration file with which a camera is estimated from its images.
AUTO = "auto"
Extrinsics = Literal["fixed", "refined", "unknown"]


@dataclass(frozen=True, eq=False)
class CameraSources:
    """Where the cameras of images come from.

    Attributes
    ----------
    names
        Names of the cameras; none for the only camera of all images.
    sources
        The cameras, their files, or "auto"; None for equirectangular images, and without calibration for others. For
        non-central cameras, the central ones of distant points.
    poses
        Poses sensor_from_rig of the cameras; none if they are not known.
    extrinsics
        How the poses are used; None if the cameras are independent.
    ray_cameras
        The non-central cameras, None for central ones; none if all are central.
    unit
        Unit of the translations of the poses.
    """

    names: tuple[str, ...]
    sources: tuple[CameraSource | None, ...]
    poses: tuple[Pose, ...] = ()
    extrinsics: Extrinsics | None = None
    ray_cameras: tuple[RayCamera | None, ...] = ()
    unit: str = "m"

    @property
    def has_scale(self) -> bool:
        """Whether known poses of cameras that are apart determine the scale of the world."""
        centers = [pose.inverse().translation for pose in self.poses]
        return bool(centers) and bool(np.ptp(centers, axis=0).any())

    @classmethod
    def of(
        cls,
        camera: AnyCameraSource | Mapping[str, AnyCameraSource] | None,
        rig: RigSource | None,
        extrinsics: Extrinsics | None,
        name: str | None = None,
    ) -> Self:
        """Return the cameras of a reconstruction.

        Raises
        ------
        ValueError
            If both a camera and a rig are given, the extrinsics or the name do not fit them, or a camera is a lens with
            mirrors.
        """
        if rig is not None:
            if camera is not None:
                raise ValueError("give a camera or a rig, not both: the rig contains its cameras")
            if name is not None:
                raise ValueError(f"--name {name}: names a camera in a file of several, and a rig is used whole")
            return cls._of_rig(rig, extrinsics or "fixed")
        if isinstance(camera, Mapping) and camera:
            if extrinsics in ("fixed", "refined"):
                raise ValueError(f"extrinsics are {extrinsics}, and only a rig (--rig) has any: use unknown, or a rig")
            return cls._of_sensors(tuple(camera), tuple(camera.values()), (), extrinsics, name)
        if extrinsics is not None:
            raise ValueError(
                f"extrinsics are {extrinsics}, and there is only one camera: leave them out, or give a rig"
            )
        return cls._of_sensors((), (None if isinstance(camera, Mapping) else camera,), (), None, name)

    @classmethod
    def _of_rig(cls, rig: RigSource, extrinsics: Extrinsics) -> Self:
        body = rig if isinstance(rig, Rig) else load_rig(Path(rig))
        poses = () if extrinsics == "unknown" else body.sensor_from_rig
        return replace(cls._of_sensors(body.names, body.cameras, poses, extrinsics, None), unit=body.unit)

    @classmethod
    def _of_sensors(
        cls,
        names: tuple[str, ...],
        sources: Sequence[AnyCameraSource | None],
        poses: tuple[Pose, ...],
        extrinsics: Extrinsics | None,
        name: str | None,
    ) -> Self:
        """Return the cameras, where non-central ones are approximated by central ones."""
        sensors = names or (None,) * len(sources)
        found = [_approximated(source, name, sensor) for source, sensor in zip(sources, sensors, strict=True)]
        rays = tuple(ray_camera for _, ray_camera in found)
        central = tuple(source for source, _ in found)
        return cls(names, central, poses, extrinsics, rays if any(ray is not None for ray in rays) else ())

    def is_unknown(self, camera: int, size: tuple[int, int]) -> bool:
        """Return whether a camera with images of a size has no calibration and is not equirectangular."""
        source = self.sources[camera]
        return source == AUTO or (source is None and size[0] != 2 * size[1])

    @property
    def is_rigid(self) -> bool:
        """Whether the cameras are rigidly connected."""
        return self.extrinsics is not None

    @property
    def estimates_extrinsics(self) -> bool:
        """Whether the poses of the cameras are unknown."""
        return self.extrinsics == "unknown"

    @property
    def refines_extrinsics(self) -> bool:
        """Whether bundle adjustment refines the poses of the cameras."""
        return self.extrinsics == "refined"


def _approximated(
    source: AnyCameraSource | None, name: str | None, sensor: str | None
) -> tuple[CameraSource | None, RayCamera | None]:
    """Return the source of a central camera, and the non-central camera that it approximates.

    A file of several cameras has that of a name, or else of a sensor.
    """
    if isinstance(source, RayCamera):
        return _distant(source, "the camera"), source
    if source is None or source == AUTO or isinstance(source, Camera):
        return source, None
    camera = load(Path(source), name=name) if name or not sensor else load_sensor(source, sensor)
    return (camera, None) if isinstance(camera, Camera) else (_distant(camera, str(source)), camera)


def _distant(camera: RayCamera, label: str) -> Camera:
    """Return the central camera of distant points."""
    if isinstance(camera.model, Catadioptric):
        raise ValueError(
            f"{label}: is a lens with mirrors ({camera.model.name}), which this command does not support: calibrate it"
            " with --model axial"
        )
    if camera.unit != "m":
        raise ValueError(f"{label}: its lengths are in {camera.unit}, not metres: calibrate it with --square")
    return camera.central(float("inf"))[0]
