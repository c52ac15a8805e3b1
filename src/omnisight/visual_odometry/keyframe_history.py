"""All keyframes of a sequence, and the places among them, for the closing of loops."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.features.keypoints import concatenate
from omnisight.geometry.pose import Pose
from omnisight.rig import Rig
from omnisight.visual_odometry.central_rig import central_cameras
from omnisight.visual_odometry.ray_observations import FrameRays
from omnisight.visual_odometry.window import KeyframeWindow

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Share of the patches of the last place that a keyframe still shows, below which it is another place: half of the
# keypoints of neighbouring places then match.
MIN_SHARE = 0.4
# Keypoints of a place in all cameras.
MAX_KEYPOINTS = 1000
# Resolution (pixels per radian) of the views in which they are detected, at most, because the time grows with the
# pixels. With 150, 106 and 75, 590, 562 and 546 loops of a rendered town, street and room are closed, none of them
# wrong, and the errors afterwards are equal within their scatter.
MAX_RESOLUTION = 106.0
# Places whose keypoints are not detected yet: their images need memory.
MAX_PENDING = 4


@dataclass(frozen=True, eq=False)
class KeyframePlace:
    """A keyframe with keypoints.

    Attributes
    ----------
    keyframe
        Its number among the keyframes.
    keypoints
        In all cameras, with bearings in the frame of the rig.
    origins
        (N, 3) of their rays, in the frame of the rig.
    """

    keyframe: int
    keypoints: Keypoints
    origins: Array


class KeyframeHistory:
    """All keyframes with their rays and points, and places with keypoints.

    A keyframe takes about 20 kB, a place 0.4 MB.

    Attributes
    ----------
    frames
        Indices of the frames of keyframes.
    poses
        Their rig_from_world, the last ones that the window estimated.
    segments
        Number of the segment of each keyframe; the relative pose of different segments is not known.
    noise
        Standard deviations of the rays of keyframes from points over the assumed ones.
    losses
        Numbers of keyframes before frames without a pose.
    points
        (P, 3) points of patches in the world, by their numbers; NaN where unknown.
    """

    def __init__(self, rig: Rig, masks: Sequence[Mask]) -> None:
        """Prepare for the images of a rig, with masks (H, W) of their usable pixels."""
        self._rig, self._masks = rig, masks
        self.frames: list[int] = []
        self.poses: list[Pose] = []
        self.segments: list[int] = []
        self.noise: list[float] = []
        self.losses = [0]
        self.points = np.full((0, 3), np.nan)
        self._row_of = dict[int, int]()
        self._rays: list[tuple[Indices, NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]] = []
        self._places: list[tuple[int, Future[list[Keypoints]], Rig]] = []
        self._at_place, self._base, self._segment = np.zeros(0, np.intp), 0, 0
        self._worker = ThreadPoolExecutor(1)

    def __len__(self) -> int:
        """Return the number of keyframes."""
        return len(self.frames)

    def start_segment(self) -> None:
        """Number patches anew: those of the next keyframes are in another world."""
        self._base, self._segment = len(self.points), self._segment + 1
        self.note_loss()

    def note_loss(self) -> None:
        """Note that frames without a pose follow the last keyframe; the next one is another place."""
        self.losses.append(len(self))
        self._at_place = np.zeros(0, np.intp)

    def update(self, window: KeyframeWindow, rig: Rig, noise: float) -> None:
        """Add the keyframes of a window that are new, with the rig that observed them, and the noise of their rays."""
        for k, keyframe in enumerate(window.keyframes):
            if keyframe.index in self._row_of:
                self.poses[self._row_of[keyframe.index]] = keyframe.rig_from_world
                continue
            rays = window.all_rays(k)
            self._row_of[keyframe.index] = len(self)
            self.frames.append(keyframe.index)
            self.poses.append(keyframe.rig_from_world)
            self.segments.append(self._segment)
            self.noise.append(noise)
            self._rays.append(
                (
                    rays.number + self._base,
                    rays.origins.astype(np.float32),
                    rays.bearings.astype(np.float32),
                    rays.axes.astype(np.float32),
                )
            )
            if keyframe.images and self._shows_another_place(rays.number):
                self._add_place(keyframe.images, rig)
                self._at_place = rays.number
        self._reserve(self._base + window.highest_number + 1)
        self.points[window.number + self._base] = window.points

    def rays(self, row: int) -> FrameRays:
        """Return the rays of a keyframe, with the points of their patches."""
        number, origins, bearings, axes = self._rays[row]
        return FrameRays(number, self.points[number], *(values.astype(float) for values in (origins, bearings, axes)))

    def places(self, first: int = 0) -> list[KeyframePlace]:
        """Return the places from one on."""
        return [self._place(*each) for each in self._places[first:]]

    def _add_place(self, images: Sequence[Bytes], rig: Rig) -> None:
        """Detect the keypoints of the last keyframe while tracking goes on."""
        if len(self._places) >= MAX_PENDING:
            wait([self._places[-MAX_PENDING][1]])
        self._places.append((len(self) - 1, self._worker.submit(self._detect, images), rig))

    def _shows_another_place(self, number: Indices) -> bool:
        """Return whether a keyframe shows few patches of the last place."""
        return not len(self._at_place) or float(np.isin(self._at_place, number).mean()) < MIN_SHARE

    def _detect(self, images: Sequence[Bytes]) -> list[Keypoints]:
        """Return the keypoints of each camera."""
        options = FeatureOptions(max_keypoints=MAX_KEYPOINTS // len(images), max_resolution=MAX_RESOLUTION)
        found = list[Keypoints]()
        for sensor, camera in enumerate(central_cameras(self._rig)):
            keypoints = detect_features(images[sensor], camera, options, mask=self._masks[sensor])
            found.append(replace(keypoints, descriptors=keypoints.descriptors.astype(np.float16)))
        return found

    def _place(self, keyframe: int, detected: "Future[list[Keypoints]]", rig: Rig) -> KeyframePlace:
        """Return a place with rays in the frame of the rig."""
        in_rig, origins = list[Keypoints](), list[Array]()
        for keypoints, sensor_from_rig in zip(detected.result(), rig.sensor_from_rig, strict=True):
            rig_from_sensor = sensor_from_rig.inverse()
            rotation = rig_from_sensor.rotation
            covariance = rotation @ keypoints.covariance @ rotation.T
            in_rig.append(replace(keypoints, bearings=keypoints.bearings @ rotation.T, covariance=covariance))
            origins.append(np.tile(rig_from_sensor.translation, (len(keypoints), 1)))
        joined = concatenate(in_rig)
        descriptors = joined.descriptors.astype(np.float32)
        descriptors /= np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-9)
        return KeyframePlace(keyframe, replace(joined, descriptors=descriptors), np.concatenate(origins))

    def _reserve(self, count: int) -> None:
        """Make room for the points of a number of patches."""
        if count > len(self.points):
            grown = np.full((max(count, 2 * len(self.points)), 3), np.nan)
            grown[: len(self.points)] = self.points
            self.points = grown
