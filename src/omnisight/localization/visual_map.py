"""Pose of an image in a map: a reconstruction whose points have the descriptors of their observations."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.optim.block_jackknife import measured_variance_ratio
from omnisight.places import PlaceIndex
from omnisight.sfm.reconstruction import Reconstruction
from omnisight.twoview.absolute_pose import AbsolutePose, resect
from omnisight.twoview.bearing_pairs import isotropic_variance

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Similar images of the map whose points are compared with the image.
NEIGHBOURS = 10
# Matches from which a pose is estimated, and agreeing ones that verify it: three determine a pose, and with this many
# bearings of a tenth of a degree no pose of unrelated matches was accepted.
MIN_MATCHES, MIN_INLIERS = 8, 10
# Least share of the matches that agree: 88 to 95 % did for rendered images of the place by four kinds of camera, and 12
# to 13 % for rooms with the same furniture in another place.
MIN_INLIER_SHARE = 0.25
# Largest distance of descriptors relative to that of the second nearest point (Lowe 2004), and largest distance of
# descriptors of unit length, as in `features.matching`.
RATIO, MAX_DISTANCE = 0.8, 0.7
# Descriptors of other observations of the same point that are skipped to find the second nearest point.
SKIPPED = 8


@dataclass(frozen=True, eq=False)
class VisualMap(Displayed):
    """A reconstruction with the descriptors of its observations.

    Attributes
    ----------
    reconstruction
        Poses, points and observations.
    descriptors
        (M, D) float32 unit descriptors of the M observations.
    """

    reconstruction: Reconstruction
    descriptors: NDArray[np.float32] = field(repr=False)

    @cached_property
    def rows(self) -> list[Indices]:
        """The observations of each image."""
        order = np.argsort(self.reconstruction.observations.image, kind="stable")
        counts = np.bincount(self.reconstruction.observations.image, minlength=len(self.reconstruction))
        return np.split(order, np.cumsum(counts)[:-1])

    @cached_property
    def index(self) -> PlaceIndex:
        """Index of the images by their descriptors."""
        index = PlaceIndex()
        for rows in self.rows:
            index.add(_keypoints(self.descriptors[rows]))
        return index

    @property
    def longest_track(self) -> tuple[int, float]:
        """Largest number of images that show one point, and largest angle (degrees) between its bearings.

        The bearings are in the frames of the cameras: 180° is a point that was ahead, and then behind.
        """
        model = self.reconstruction
        seen = model.observations
        if not len(seen):
            return 0, 0.0
        images = np.bincount(seen.point, minlength=len(model.points))
        poses = [model.cam_from_world(i) for i in range(len(model))]
        rotations, translations = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
        at = np.einsum("mij,mj->mi", rotations[seen.image], model.points.position[seen.point])
        bearings = at + translations[seen.image]
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
        order = np.argsort(seen.point, kind="stable")
        widest = 0.0
        for rows in np.split(order, np.flatnonzero(np.diff(seen.point[order])) + 1):
            widest = max(widest, float(np.arccos(np.clip((bearings[rows] @ bearings[rows].T).min(), -1, 1))))
        return int(images.max()), float(np.degrees(widest))


@dataclass(frozen=True, eq=False)
class LocalizedImage(Displayed):
    """The pose of an image in a map; false if it is unknown.

    Attributes
    ----------
    cam_from_world
        The pose, in the unit of the map; None if it is unknown.
    covariance
        (6, 6) of the step (w, v) of `Pose.moved`, from the noise of keypoints and points, and its correlation in
        neighbouring directions.
    matches, inliers
        Points that were matched, and that agree with the pose.
    nearest
        The most similar image of the map; empty if there is none.
    reason
        Why the pose is unknown; empty otherwise.
    is_readable
        Whether the image can be read.
    """

    cam_from_world: Pose | None
    covariance: Array = field(repr=False)
    matches: int
    inliers: int
    nearest: str
    reason: str = ""
    is_readable: bool = True

    @classmethod
    def without_pose(
        cls, reason: str, matches: int = 0, inliers: int = 0, nearest: str = "", *, is_readable: bool = True
    ) -> Self:
        """Return the result of an image whose pose is unknown."""
        return cls(None, np.full((6, 6), np.nan), matches, inliers, nearest, reason, is_readable)

    def __bool__(self) -> bool:
        """Return whether the pose is known."""
        return self.cam_from_world is not None

    @property
    def sigmas(self) -> tuple[float, float]:
        """Standard deviations of the angle of the rotation (radians) and of the distance of the camera.

        They are root mean squares over the three axes together.
        """
        assert self.cam_from_world is not None
        position = self.cam_from_world.position_covariance(self.covariance)
        return float(np.sqrt(np.trace(self.covariance[:3, :3]))), float(np.sqrt(np.trace(position)))


def localize(keypoints: Keypoints, visual_map: VisualMap) -> LocalizedImage:
    """Estimate the pose of an image from its keypoints.

    The keypoints are matched with the points that the most similar images of the map show; LO-RANSAC and the
    maximum-likelihood estimate of `resect` give the pose, first with the noise of the keypoints and then also with that
    of the points, at their distances. Points in one direction share the errors of the images of the map that saw them:
    the covariance is multiplied by the ratio that a jackknife over blocks of directions measures, if it is above 1.

    Parameters
    ----------
    keypoints
        Of an image of any camera.
    visual_map
        The map.
    """
    model = visual_map.reconstruction
    places = visual_map.index.query(keypoints, NEIGHBOURS) if len(keypoints) else []
    if not places:
        return LocalizedImage.without_pose("no image of the map is similar: another place, or no texture")
    nearest = model.names[places[0].image]
    rows = np.concatenate([visual_map.rows[place.image] for place in places])
    pairs = match_points(keypoints.descriptors, visual_map.descriptors[rows], model.observations.point[rows])
    if len(pairs) < MIN_MATCHES:
        reason = f"{len(pairs)} matches with the points of the map, at least {MIN_MATCHES} are needed"
        return LocalizedImage.without_pose(reason, len(pairs), nearest=nearest)
    seen, points = keypoints[pairs[:, 0]], model.points.position[pairs[:, 1]]
    found, noise = resect(points, seen.bearings, seen.covariance), seen.covariance
    if found:
        noise = seen.covariance + _seen_covariance(found, points, model.points.covariance[pairs[:, 1]])
        found = resect(points, seen.bearings, noise) or found
    inliers = int(found.inliers.sum())
    if not found or inliers < MIN_INLIERS:
        reason = found.reason or f"{inliers} of {len(pairs)} matches agree with a pose, {MIN_INLIERS} are needed"
        return LocalizedImage.without_pose(reason, len(pairs), inliers, nearest)
    if inliers < MIN_INLIER_SHARE * len(pairs):
        reason = f"only {inliers} of {len(pairs)} matches agree with a pose: another place with similar objects"
        return LocalizedImage.without_pose(reason, len(pairs), inliers, nearest)
    ratio = _variance_ratio(found, points, seen.bearings, noise)
    are_points_known = np.isfinite(model.points.covariance[pairs[found.inliers, 1]]).all()
    covariance = ratio * found.covariance if are_points_known else np.full((6, 6), np.nan)
    return LocalizedImage(found.cam_from_world, covariance, len(pairs), inliers, nearest)


def match_points(descriptors: NDArray[np.float32], of_points: NDArray[np.float32], point: Indices) -> Indices:
    """Return the pairs (M, 2) of a keypoint and a point that are mutually nearest by their descriptors.

    A point has one descriptor per observation. The second nearest of the ratio test is that of another point.

    Parameters
    ----------
    descriptors
        (N, D) unit vectors.
    of_points, point
        (K, D) unit vectors and the points (K,) that they belong to.
    """
    similarity = descriptors @ of_points.T
    count = min(SKIPPED, similarity.shape[1])
    top = np.argpartition(-similarity, count - 1, axis=1)[:, :count]
    values = np.take_along_axis(similarity, top, axis=1)
    order = np.argsort(-values, axis=1)
    top, values = np.take_along_axis(top, order, axis=1), np.take_along_axis(values, order, axis=1)
    is_other = point[top] != point[top[:, :1]]
    second = np.where(is_other.any(1), np.take_along_axis(values, is_other.argmax(1)[:, None], 1)[:, 0], -1.0)
    distance, other = (np.sqrt(np.maximum(2 - 2 * s, 0)) for s in (values[:, 0], second))
    best = top[:, 0]
    mutual = similarity.argmax(0)[best] == np.arange(len(descriptors))
    chosen = np.flatnonzero((distance <= MAX_DISTANCE) & (distance <= RATIO * other) & mutual)
    # Of several keypoints of one point, the nearest one is kept.
    chosen = chosen[np.argsort(distance[chosen], kind="stable")]
    _, first = np.unique(point[best[chosen]], return_index=True)
    kept = np.sort(chosen[first])
    return np.column_stack([kept, point[best[kept]]])


def _seen_covariance(found: AbsolutePose, points: Array, covariance: Array) -> Array:
    """Return the covariances (N, 3, 3) of the bearings of points due to those of the points (N, 3, 3)."""
    pose = found.cam_from_world
    assert pose is not None
    at = pose @ points
    distance = np.linalg.norm(at, axis=1)
    bearings = at / distance[:, None]
    tangent = (np.eye(3) - bearings[:, :, None] * bearings[:, None, :]) / distance[:, None, None]
    by_point = tangent @ pose.rotation
    finite = np.where(np.isfinite(covariance).all((1, 2), keepdims=True), covariance, 0.0)
    return by_point @ finite @ np.swapaxes(by_point, 1, 2)


def _variance_ratio(found: AbsolutePose, points: Array, bearings: Array, noise: Array) -> float:
    """Return how much larger the covariance of a pose is than that of independent inliers, at least 1."""
    from omnisight.twoview._absolute_pose_kernel import AbsolutePoseProblem

    assert found.cam_from_world is not None
    use = found.inliers
    problem = AbsolutePoseProblem(points[use], bearings[use], noise[use], isotropic_variance(noise[use]))
    return max(measured_variance_ratio(problem, found.cam_from_world.matrix, bearings[use]), 1.0)


def _keypoints(descriptors: NDArray[np.float32]) -> Keypoints:
    """Return keypoints with descriptors only."""
    count = len(descriptors)
    return Keypoints(np.zeros((count, 2)), np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count), descriptors)
