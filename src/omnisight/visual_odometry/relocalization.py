"""Relocalization: the pose of a frame in the map of the last keyframes, by descriptors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.features import FeatureOptions, Keypoints, detect_features, match_features, match_guided
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.rig import Rig
from omnisight.twoview.bearing_pairs import isotropic_variance
from omnisight.twoview.triangulation import triangulate
from omnisight.visual_odometry.central_rig import central_cameras
from omnisight.visual_odometry.window import Keyframe

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Keypoints of each image: those of a frame of ordinary texture.
MAX_KEYPOINTS = 1500
# Keyframes between the two that determine the points.
BASELINE_KEYFRAMES = 3
# Matches that must agree with the pose, and their share: 75 % two seconds later in a room, and up to 35 % in the mirror
# image of the room, whose textures are similar.
MIN_INLIERS, MIN_SHARE = 15, 0.5


@dataclass(frozen=True, eq=False)
class DescribedPoints:
    """Points of the map with the keypoints of one image.

    Attributes
    ----------
    points
        (N, 3) in the world.
    keypoints
        (N) the keypoints.
    """

    points: Array
    keypoints: Keypoints


class Relocalizer:
    """The map of two keyframes, with descriptors."""

    def __init__(self, rig: Rig, masks: Sequence[Mask], keyframes: Sequence[Keyframe]) -> None:
        """Triangulate the keypoints of the last keyframe and of one before it."""
        self._rig, self._cameras, self._masks = rig, central_cameras(rig), masks
        last, before = keyframes[-1], keyframes[max(len(keyframes) - 1 - BASELINE_KEYFRAMES, 0)]
        self._maps = [self._describe(sensor, last, before) for sensor in range(len(rig))]

    def locate(self, images: Sequence[Bytes], seed: int) -> tuple[Pose | None, str]:
        """Return rig_from_world of a frame, or None with the reason."""
        from omnisight.visual_odometry._ray_pose_kernel import RayPoseProblem

        keypoints = [self.detect(sensor, image) for sensor, image in enumerate(images)]
        points, origins, bearings, variances = list[Array](), list[Array](), list[Array](), list[Array]()
        for sensor, found in enumerate(keypoints):
            described = self._maps[sensor]
            pairs = match_features(described.keypoints, found).pairs
            rays = self._rig.rays(sensor, found.pixels[pairs[:, 1]])
            points.append(described.points[pairs[:, 0]])
            origins.append(rays.origins)
            bearings.append(rays.bearings)
            variances.append(isotropic_variance(found.covariance[pairs[:, 1]]))
        x, o, b, variance = (np.concatenate(parts) for parts in (points, origins, bearings, variances))
        use = np.isfinite(b).all(axis=1)
        x, o, b, variance = x[use], o[use], b[use], variance[use]
        axes = _tangents(b)

        def problem(scale: float) -> RayPoseProblem:
            sigma = scale * np.sqrt(variance)
            return RayPoseProblem(x, o, b, axes / sigma[:, None, None], sigma**2)

        found = estimate_robustly(problem, is_scale_known=False, options=RansacOptions(seed=seed, max_iterations=2000))
        if found.model is None or found.inliers.sum() < max(MIN_INLIERS, MIN_SHARE * len(x)):
            return None, f"{found.inliers.sum()} of {len(x)} matches with the last keyframe agree with a pose"
        return Pose.of_matrix(found.model), ""

    def detect(self, sensor: int, image: Bytes) -> Keypoints:
        """Return the keypoints of an image."""
        options = FeatureOptions(max_keypoints=MAX_KEYPOINTS)
        return detect_features(image, self._cameras[sensor], options, mask=self._masks[sensor])

    def _describe(self, sensor: int, last: Keyframe, before: Keyframe) -> DescribedPoints:
        """Return the keypoints of the last keyframe whose points are known."""
        a, b = (self.detect(sensor, keyframe.images[sensor]) for keyframe in (last, before))
        sensor_from_rig = self._rig.sensor_from_rig[sensor]
        poses = [sensor_from_rig @ keyframe.rig_from_world for keyframe in (last, before)]
        pairs = match_guided(a, b, poses[1] @ poses[0].inverse()).pairs
        a, b = a[pairs[:, 0]], b[pairs[:, 1]]
        found = triangulate(poses, np.stack([a.bearings, b.bearings]), np.stack([a.covariance, b.covariance]))
        return DescribedPoints(found.points[found.valid], a[found.valid])


def _tangents(bearings: Array) -> Array:
    """Return two perpendicular unit vectors (N, 2, 3) of each bearing (N, 3)."""
    helper = np.eye(3)[np.abs(bearings).argmin(axis=1)]
    first = np.cross(bearings, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.asarray(np.stack([first, np.cross(bearings, first)], axis=1), float)
