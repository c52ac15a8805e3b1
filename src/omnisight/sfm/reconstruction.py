"""The result of structure from motion: poses of images, points, and their observations."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class PointObservations(Displayed):
    """Observations of points in images.

    Attributes
    ----------
    image, point
        (M,) indices of the image and of the point.
    pixels
        (M, 2) in the image.
    residuals
        (M, 2) projected minus observed pixels.
    keypoint
        (M,) index among the keypoints of the image; None for observations of a file.
    """

    image: Indices
    point: Indices
    pixels: Array
    residuals: Array = field(repr=False)
    keypoint: Indices | None = field(default=None, repr=False)

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.image)

    def select(self, use: NDArray[Any]) -> "PointObservations":
        """Return the observations of a mask (M,) or of indices."""
        keypoint = None if self.keypoint is None else self.keypoint[use]
        return PointObservations(self.image[use], self.point[use], self.pixels[use], self.residuals[use], keypoint)


@dataclass(frozen=True, eq=False)
class Points(Displayed):
    """Reconstructed points.

    Attributes
    ----------
    position
        (P, 3) in the world frame.
    covariance
        (P, 3, 3) in the gauge of the reconstruction.
    color
        (P, 3) uint8 RGB.
    """

    position: Array
    covariance: Array = field(repr=False)
    color: NDArray[np.uint8] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.position)


@dataclass(frozen=True, eq=False)
class Reconstruction(Displayed):
    """Poses of images and points in one world frame.

    A frame is what the sensors of a rig see at one time. Independent cameras are the sensors of a rig whose poses are
    identities, and each image is a frame of its own.

    Attributes
    ----------
    rig
        The cameras.
    names
        Name of each image: its path relative to the image folder, with "/".
    sensor
        (I,) index of the camera of each image.
    frame
        (I,) index of the frame of each image.
    rig_from_world
        Pose of each frame.
    pose_covariance
        (F, 6, 6) covariances of the steps (w, v) of `Pose.moved` of these poses: relative to the first frame, which has
        none, and is verified if any is, and to the scale; in the world for known positions. NaN for images without
        points.
    points
        The points; none in a graph of panoramas that were taken in one place.
    observations
        What the images see of them.
    has_scale
        Whether the unit of the world is the metre; otherwise it is arbitrary.
    origin
        Latitude and longitude, degrees, and altitude, metres, of the origin of the world, whose axes are then east,
        north and up; None if the place is unknown.
    unverified
        Names of the images of frames that are not verified, see `verified_frames`; none of two frames.
    """

    rig: Rig
    names: tuple[str, ...]
    sensor: Indices
    frame: Indices
    rig_from_world: tuple[Pose, ...]
    pose_covariance: Array = field(repr=False)
    points: Points
    observations: PointObservations
    has_scale: bool = False
    origin: tuple[float, float, float] | None = None
    unverified: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Summarize the reconstruction in one line."""
        unit = "metric" if self.has_scale else "scale unknown"
        cameras = f"{len(self.rig)} camera{'s' if len(self.rig) > 1 else ''}"
        return (
            f"Reconstruction({len(self)} images of {cameras}, {len(self.points)} points, {len(self.observations)}"
            f" observations, {unit})"
        )

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.names)

    def cam_from_world(self, image: int) -> Pose:
        """Return the pose of an image."""
        return self.rig.sensor_from_rig[self.sensor[image]] @ self.rig_from_world[self.frame[image]]

    def world_from_cam(self, image: int) -> Pose:
        """Return the inverse of the pose of an image: its translation is the position of the camera."""
        return self.cam_from_world(image).inverse()

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale, if it is the metre: of the distance of the farthest frame.

        For frames in one place, such as the only one of a rig, it is the median of the distances of the points.
        """
        positions = np.array([pose.inverse().translation for pose in self.rig_from_world])
        baselines = positions - positions[0]
        farthest = int(np.linalg.norm(baselines, axis=1).argmax())
        length = float(np.linalg.norm(baselines[farthest]))
        if not length:
            return self._point_distance_sigma(positions[0])
        along, variance = baselines[farthest] / length, 0.0
        for frame in (0, farthest):
            covariance = self.rig_from_world[frame].position_covariance(self.pose_covariance[frame])
            variance += along @ covariance @ along
        return float(np.sqrt(variance)) / length

    def _point_distance_sigma(self, position: Array) -> float:
        """Return the median relative standard deviation of the distances of points from a position; NaN without."""
        if not len(self.points):
            return float("nan")
        offsets = self.points.position - position
        distances = np.linalg.norm(offsets, axis=1)
        variances = np.einsum("ni,nij,nj->n", offsets, self.points.covariance, offsets) / distances**4
        return float(np.median(np.sqrt(variances)))

    @property
    def rms_px(self) -> float:
        """Root mean square length of the residuals, px; NaN without observations.

        Residuals along the rows of 360 images are in pixels of the equator, because they have no limit at the poles.
        """
        squares = self.observations.residuals**2
        of_sensor = self.sensor[self.observations.image]
        for s, camera in enumerate(self.rig.cameras):
            if isinstance(camera, Camera) and (period := getattr(camera.model, "period", None)) is not None:
                use = of_sensor == s
                by_pixel = camera.model.unproject_with_jacobians(self.observations.pixels[use])[2]
                squares[use, 0] *= (by_pixel[:, :, 0] ** 2).sum(axis=1) * (period / (2 * np.pi)) ** 2
        return float(np.sqrt(squares.sum(axis=1).mean())) if len(squares) else float("nan")

    @property
    def rotation_sigma_deg(self) -> float:
        """Median standard deviation of the rotations of verified frames relative to the first; NaN without any."""
        variance = np.trace(self.pose_covariance[:, :3, :3], axis1=1, axis2=2) / 3
        is_used = (self.frame > 0) & ~np.isin(self.names, self.unverified)
        return float(np.degrees(np.median(np.sqrt(variance[self.frame[is_used]])))) if is_used.any() else float("nan")

    @property
    def mean_track_length(self) -> float:
        """Mean number of observations of a point; NaN without points."""
        return len(self.observations) / len(self.points) if len(self.points) else float("nan")
