"""Pose of an image in a map of other images."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.features import Keypoints
from omnisight.geometry.pose import Pose
from omnisight.localization.matched_points import MatchedPoints, match_points
from omnisight.localization.visual_map import VisualMap
from omnisight.optim.block_jackknife import measured_variance_ratio

Array = NDArray[np.float64]

# Similar images of the map whose points are compared with the image.
NEIGHBOURS = 10
# Matches from which a pose is estimated, and agreeing ones that verify it: three determine a pose, and with this many
# bearings of a tenth of a degree no pose of unrelated matches was accepted.
MIN_MATCHES, MIN_INLIERS = 8, 10
# Least share of the matches that agree: 88 to 95 % did for rendered images of the place by four kinds of camera, and 12
# to 13 % for rooms with the same furniture in another place.
MIN_INLIER_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class LocalizedImage(Displayed):
    """The pose of an image in a map; false if it is unknown.

    Attributes
    ----------
    cam_from_world
        The pose, in the unit of the map; None if it is unknown.
    covariance
        (6, 6) of the step (w, v) of `Pose.moved`: from the noise of keypoints and points, its correlation in
        neighbouring directions, and the covariance of the calibration.
    matches, inliers
        Points that were matched, and that agree with the pose.
    nearest
        The most similar image of the map; empty if there is none.
    reason
        Why the pose is unknown; empty otherwise.
    is_usable
        Whether the image can be read and has the size of the camera.
    matched_points, is_inlier
        The matches of a known pose, and (N,) which of them agree with it.
    """

    cam_from_world: Pose | None
    covariance: Array = field(repr=False)
    matches: int
    inliers: int
    nearest: str
    reason: str = ""
    is_usable: bool = True
    matched_points: MatchedPoints | None = field(default=None, repr=False)
    is_inlier: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_), repr=False)

    @classmethod
    def without_pose(
        cls, reason: str, matches: int = 0, inliers: int = 0, nearest: str = "", *, is_usable: bool = True
    ) -> Self:
        """Return the result of an image whose pose is unknown."""
        return cls(None, np.full((6, 6), np.nan), matches, inliers, nearest, reason, is_usable)

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


def localize(keypoints: Keypoints, visual_map: VisualMap, camera: Camera) -> LocalizedImage:
    """Estimate the pose of an image from its keypoints.

    The keypoints are matched with the points that the most similar images of the map show; LO-RANSAC and the
    maximum-likelihood estimate of `resect` give the pose. See `pose_covariance` for its covariance.

    Parameters
    ----------
    keypoints
        Of an image of any camera.
    visual_map
        The map.
    camera
        The camera of the image.
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
    matched = MatchedPoints.of(keypoints[pairs[:, 0]], camera, model.points, pairs[:, 1])
    found = matched.resect()
    inliers = int(found.inliers.sum())
    if found.cam_from_world is None or inliers < MIN_INLIERS:
        reason = found.reason or f"{inliers} of {len(pairs)} matches agree with a pose, {MIN_INLIERS} are needed"
        return LocalizedImage.without_pose(reason, len(pairs), inliers, nearest)
    if inliers < MIN_INLIER_SHARE * len(pairs):
        reason = f"only {inliers} of {len(pairs)} matches agree with a pose: another place with similar objects"
        return LocalizedImage.without_pose(reason, len(pairs), inliers, nearest)
    covariance = pose_covariance(matched[found.inliers], found.cam_from_world, found.covariance)
    figures = covariance, len(pairs), inliers, nearest
    return LocalizedImage(found.cam_from_world, *figures, matched_points=matched, is_inlier=found.inliers)


def pose_covariance(inliers: MatchedPoints, cam_from_world: Pose, independent: Array) -> Array:
    """Return the covariance (6, 6) of a pose that is estimated with the camera of a calibration.

    Points in one direction share the errors of the images of the map that saw them: the covariance of independent
    errors is multiplied by the ratio that a jackknife over blocks of directions measures, if it is above 1. All
    observations share the error c of the calibration, which moves the pose of least squares by -(J^T J)^-1 J^T A c,
    with the derivatives J and A of the residuals by pose and parameters (implicit function theorem). What that error
    explains of the residuals is not counted again by the jackknife. NaN if the covariance of a point is unknown.

    Parameters
    ----------
    inliers
        The matches that agree with the pose.
    cam_from_world
        The pose.
    independent
        (6, 6) covariance of the pose for independent errors.
    """
    if not np.isfinite(inliers.point_covariance).all():
        return np.full((6, 6), np.nan)
    linearized = inliers.linearize(cam_from_world)
    by_calibration = linearized.by_params @ inliers.calibration
    residuals = linearized.unexplained(by_calibration)
    ratio = max(measured_variance_ratio(residuals, linearized.by_pose, inliers.bearings), 1.0)
    response = linearized.response(by_calibration)
    return ratio * independent + response @ response.T
