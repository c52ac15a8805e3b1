"""The cameras that a user specifies for a set of images: one, several by name, or a rig."""

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal, Self

import numpy as np

from omnisight.camera import Camera
from omnisight.formats import load_rig
from omnisight.geometry.pose import Pose
from omnisight.pipeline.central_camera import CameraSource
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
        The cameras, their files, or "auto"; None for equirectangular images, and without calibration for others.
    poses
        Poses sensor_from_rig of the cameras; none if they are not known.
    extrinsics
        How the poses are used; None if the cameras are independent.
    """

    names: tuple[str, ...]
    sources: tuple[CameraSource | None, ...]
    poses: tuple[Pose, ...] = ()
    extrinsics: Extrinsics | None = None

    @property
    def has_scale(self) -> bool:
        """Whether known poses of cameras that are apart determine the scale of the world."""
        centers = [pose.inverse().translation for pose in self.poses]
        return bool(centers) and bool(np.ptp(centers, axis=0).any())

    @classmethod
    def of(
        cls,
        camera: CameraSource | Mapping[str, CameraSource] | None,
        rig: RigSource | None,
        extrinsics: Extrinsics | None,
    ) -> Self:
        """Return the cameras of a reconstruction.

        Raises
        ------
        ValueError
            If both a camera and a rig are given, or the extrinsics do not fit them.
        """
        if rig is not None:
            if camera is not None:
                raise ValueError("give a camera or a rig, not both: the rig contains its cameras")
            return cls._of_rig(rig, extrinsics or "fixed")
        if isinstance(camera, Mapping) and camera:
            if extrinsics in ("fixed", "refined"):
                raise ValueError(f"extrinsics are {extrinsics}, and only a rig (--rig) has any: use unknown, or a rig")
            return cls(tuple(camera), tuple(camera.values()), (), extrinsics)
        if extrinsics is not None:
            raise ValueError(
                f"extrinsics are {extrinsics}, and there is only one camera: leave them out, or give a rig"
            )
        return cls((), (None if isinstance(camera, Mapping) else camera,))

    @classmethod
    def _of_rig(cls, rig: RigSource, extrinsics: Extrinsics) -> Self:
        body = rig if isinstance(rig, Rig) else load_rig(Path(rig))
        label = "the rig" if isinstance(rig, Rig) else str(rig)
        cameras: list[Camera] = []
        for name, camera in zip(body.names, body.cameras, strict=True):
            if not isinstance(camera, Camera):
                raise ValueError(
                    f"{label}: {name} is a non-central camera ({camera.model.name}), which this command does not"
                    " support: use the central one, of --model auto"
                )
            cameras.append(camera)
        poses = () if extrinsics == "unknown" else body.sensor_from_rig
        return cls(body.names, tuple(cameras), poses, extrinsics)

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
