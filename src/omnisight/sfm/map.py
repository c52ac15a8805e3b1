"""A map: poses of frames, and the points that their images show."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_map
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.incidence import grouped
from omnisight.sfm.measurements import Measurements
from omnisight.sfm.missing_matches import ComparedImages, KnownPoints, predicted_matches_of_poses
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.structure import RayObservations, Structure
from omnisight.sfm.tracks import Tracks
from omnisight.sfm.verification import verified_frames
from omnisight.sfm.view_graph import ViewGraph

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Map:
    """Poses of frames and sensors, and points with their tracks.

    Attributes
    ----------
    images
        The images, with the rays of the refined cameras.
    frames
        (F,) indices of frames.
    rig_from_world
        (F, 3, 4) poses of these frames.
    sensor_from_rig
        (S, 3, 4) poses of all sensors.
    points
        (P, 3); none if all frames were taken in one place.
    tracks
        Observations of the points.
    noise
        Distribution of the residuals in units of the standard deviations of the keypoints.
    graph
        The relative poses of the images.
    refines_sensors
        Whether bundle adjustment refines the poses of the sensors.
    values
        (Q,) of free cameras.
    measured
        What was measured in metres.
    verified
        (V,) indices of the frames that are verified, see `with_verification`; none before.
    sensor_covariance
        (6 S, 6 S) of the poses of the sensors if several maps have determined them; None otherwise.
    """

    images: RigImages
    frames: Indices
    rig_from_world: Array
    sensor_from_rig: Array
    points: Array
    tracks: Tracks
    noise: StudentT
    graph: ViewGraph
    refines_sensors: bool = False
    values: Array = field(default_factory=lambda: np.zeros(0))
    measured: Measurements | None = None
    verified: Indices = field(default_factory=lambda: np.zeros(0, np.intp))
    sensor_covariance: Array | None = None

    @property
    def has_scale(self) -> bool:
        """Whether the unit of the world is the metre."""
        return self.measured is not None or self.images.has_scale(self.frames)

    @cached_property
    def row_of_image(self) -> Indices:
        """Row (I,) of the frame of each image; -1 outside the map."""
        row = np.full(self.images.frames, -1)
        row[self.frames] = np.arange(len(self.frames))
        return row[self.images.frame]

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The free cameras; none if the cameras are fixed."""
        return () if self.images.pixels is None else self.images.pixels.free.at(self.values)

    @property
    def structure(self) -> Structure:
        """Poses and points of the bundle adjustment."""
        return Structure(self.rig_from_world, self.sensor_from_rig, self.points, self.values)

    @property
    def bundle(self) -> Bundle:
        """The least-squares problem of the poses and points."""
        images, image = self.images, self.tracks.image
        which = images.keypoints(self.tracks)
        of_rays = images.origins[which], images.bearings[which], images.axes[which]
        rays = RayObservations(self.row_of_image[image], images.sensor[image], self.tracks.track, *of_rays)
        pixels = None if images.pixels is None else images.pixels[which]
        has_scale = images.has_scale(self.frames)
        return Bundle(rays, self.noise, self.structure, has_scale, self.refines_sensors, pixels, self.measured)

    def cam_from_world(self, image: int) -> Pose:
        """Return the pose of an image of the map."""
        of_sensor = Pose.of_matrix(self.sensor_from_rig[self.images.sensor[image]])
        return of_sensor @ Pose.of_matrix(self.rig_from_world[self.row_of_image[image]])

    def with_frames(self, keep: NDArray[np.bool_]) -> "Map":
        """Return the map of some of its frames (F,), and the points that two of their images show."""
        supported, used = self.tracks.select(keep[self.row_of_image[self.tracks.image]])
        return replace(
            self,
            frames=self.frames[keep],
            rig_from_world=self.rig_from_world[keep],
            points=self.points[used],
            tracks=supported,
        )

    def with_poses(self, frames: Indices, rig_from_world: Array) -> "Map":
        """Return the map with poses (J, 3, 4) of some frames (J,), which may be in the map; the points are the same."""
        others = ~np.isin(self.frames, frames)
        return replace(
            self,
            frames=np.concatenate([self.frames[others], frames]),
            rig_from_world=np.concatenate([self.rig_from_world[others], rig_from_world]),
        )

    @property
    def is_verified(self) -> NDArray[np.bool_]:
        """Which frames (F,) are verified."""
        return np.isin(self.frames, self.verified)

    def with_verification(self) -> "Map":
        """Return the map with its verified frames, see `verified_frames`, before the others.

        Covariances are relative to the first frame.
        """
        image, point, share = self.tracks.image, self.tracks.track, self.graph.repeatability
        is_verified = verified_frames(image, point, self.row_of_image, self.compared, share)
        order = np.argsort(~is_verified, kind="stable")
        verified = self.frames[is_verified]
        return replace(self, frames=self.frames[order], rig_from_world=self.rig_from_world[order], verified=verified)

    @cached_property
    def compared(self) -> ComparedImages:
        """The pairs of images with points that were compared, with the matches that their poses predict."""
        row, known = self.row_of_image, self.known_points
        pairs = [(a, b) for a, b in self.graph.compared if a in known and b in known and row[a] != row[b]]
        poses = {image: self.cam_from_world(image) for image in known}
        matches = [self.all_matches(*pair) for pair in pairs]
        predictions = predicted_matches_of_poses(pairs, matches, known, poses)
        return ComparedImages(np.array(pairs, np.intp).reshape(-1, 2), predictions)

    def all_matches(self, a: int, b: int) -> Indices:
        """Return the keypoints (N, 2) of two images that match, also far ones, or show a point by other images."""
        (of_a, in_a), (of_b, in_b) = self.observations[a], self.observations[b]
        _, first, second = np.intersect1d(of_a, of_b, return_indices=True)
        by_others = np.column_stack([in_a[first], in_b[second]])
        pairs = np.concatenate([self.graph.matches_of(a, b), by_others])
        return pairs[np.unique(pairs @ [self.images.offsets[-1], 1], return_index=True)[1]]

    @cached_property
    def observations(self) -> dict[int, tuple[Indices, Indices]]:
        """Points of each image, and their keypoints."""
        return {image: (self.tracks.track[i], self.tracks.keypoint[i]) for image, i in grouped(self.tracks.image)}

    @cached_property
    def known_points(self) -> dict[int, KnownPoints]:
        """Keypoints of each image with points, with their distances."""

        def of_image(image: int) -> KnownPoints:
            points, keypoints = self.observations[image]
            distances = np.linalg.norm(self.cam_from_world(image) @ self.points[points], axis=1)
            return KnownPoints.of(self.images.bearings_of(image), keypoints, distances)

        return dict(zip(self.observations, parallel_map(of_image, list(self.observations)), strict=True))
