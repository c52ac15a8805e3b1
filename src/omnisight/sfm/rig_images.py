"""Images of the sensors of a rig, and the rays of their keypoints."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.ray_camera import RayCamera
from omnisight.sfm.pixel_rays import FreeCameras, PixelRays
from omnisight.sfm.tracks import Tracks
from omnisight.twoview.triangulation import whitening

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RigImages:
    """Images that the sensors of a rig took of frames, with the rays of their keypoints.

    Independent cameras are sensors whose poses are identities, and each of their images is a frame of its own.

    Attributes
    ----------
    sensor, frame
        (I,) indices of the sensor and of the frame of each image.
    sensor_from_rig
        (S, 3, 4).
    offsets
        (I + 1,) first keypoint of each image.
    origins, bearings, axes
        (K, 3), (K, 3) and (K, 2, 3) of all keypoints; see `RayObservations`.
    is_rig_known
        Whether the poses of the sensors were given, and not estimated.
    pixels
        (K,) pixels of all keypoints, if bundle adjustment refines the cameras.
    """

    sensor: Indices
    frame: Indices
    sensor_from_rig: Array
    offsets: Indices
    origins: Array
    bearings: Array
    axes: Array
    is_rig_known: bool = False
    pixels: PixelRays | None = None

    @classmethod
    def of(cls, keypoints: Sequence[Keypoints], sensor: Indices | None = None, sensors: int = 1) -> Self:
        """Return the images of independent cameras; by default they are all of the same."""
        offsets = np.concatenate([[0], np.cumsum([len(k) for k in keypoints])]).astype(np.intp)
        bearings = np.concatenate([k.bearings for k in keypoints])
        axes = whitening(np.concatenate([k.covariance for k in keypoints]))
        of_image = np.zeros(len(keypoints), np.intp) if sensor is None else sensor
        poses = np.tile(Pose().matrix, (sensors, 1, 1))
        return cls(of_image, np.arange(len(keypoints)), poses, offsets, np.zeros_like(bearings), bearings, axes)

    def on_rig(self, frame: Indices, sensor_from_rig: Array, *, is_known: bool) -> Self:
        """Return the images as those of the sensors of a rig."""
        return replace(self, frame=frame, sensor_from_rig=sensor_from_rig, is_rig_known=is_known)

    def with_free_cameras(self, free: FreeCameras, keypoints: Sequence[Keypoints]) -> Self:
        """Return the images with cameras that bundle adjustment refines; the rays are those of their first values."""
        sensor = np.repeat(self.sensor, np.diff(self.offsets))
        return replace(
            self, pixels=PixelRays.of(free, sensor, np.concatenate([k.pixels for k in keypoints]), self.axes)
        )

    def with_ray_cameras(self, cameras: Sequence[RayCamera | None], keypoints: Sequence[Keypoints]) -> Self:
        """Return the images with the exact rays of non-central cameras, whose unit is then that of the world."""
        sensor = np.repeat(self.sensor, np.diff(self.offsets))
        pixels = np.concatenate([k.pixels for k in keypoints])
        origins, bearings = self.origins.copy(), self.bearings.copy()
        for k, camera in enumerate(cameras):
            if camera is not None:
                use = np.flatnonzero(sensor == k)
                rays = camera.rays(pixels[use])
                use, known = use[rays.valid], rays.valid
                origins[use], bearings[use] = rays.origins[known], rays.bearings[known]
        # The tangents follow the small change of the bearings.
        axes = self.axes - np.einsum("nij,nj->ni", self.axes, bearings)[:, :, None] * bearings[:, None, :]
        return replace(self, origins=origins, bearings=bearings, axes=axes)

    def at(self, values: Array) -> Self:
        """Return the images with the rays for values (Q,) of free cameras."""
        if self.pixels is None:
            return self
        bearings, axes = self.pixels.at(values)
        return replace(self, bearings=bearings, axes=axes)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.frame.max(initial=-1)) + 1

    @property
    def centers(self) -> Array:
        """Positions (S, 3) of the sensors in the rig."""
        return -np.einsum("sji,sj->si", self.sensor_from_rig[:, :, :3], self.sensor_from_rig[:, :, 3])

    def has_scale(self, frames: Indices) -> bool:
        """Return whether sensors that are known to be apart took images of some frames."""
        used = self.centers[np.unique(self.sensor[np.isin(self.frame, frames)])]
        return self.is_rig_known and bool(np.ptp(used, axis=0).any())

    def bearings_of(self, image: int) -> Array:
        """Return the bearings (N, 3) of the keypoints of an image, by its refined camera."""
        return self.bearings[self.offsets[image] : self.offsets[image + 1]]

    def keypoints(self, tracks: Tracks) -> Indices:
        """Return the indices (M,) of the keypoints of observations among those of all images."""
        return self.offsets[tracks.image] + tracks.keypoint

    def known_pose(self, a: int, b: int) -> Pose | None:
        """Return the relative pose of two images of one frame; None for others."""
        if self.frame[a] != self.frame[b]:
            return None
        of_a, of_b = (Pose.of_matrix(self.sensor_from_rig[self.sensor[image]]) for image in (a, b))
        return of_b @ of_a.inverse()
