"""Distances from two images of a rig: the counterpart of `omnisight stereo`."""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed, named_tuple_text
from omnisight.features import detect_features, match_features
from omnisight.features.detection import illuminated_region
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_between
from omnisight.images import to_gray8
from omnisight.images.colors import colors_at
from omnisight.optim.loss import NORMAL_MEDIAN
from omnisight.optim.ransac import RansacOptions
from omnisight.pipeline.inputs.camera_sources import RigSource
from omnisight.pipeline.inputs.photo import MIN_KEYPOINTS, ImageSource, Photo
from omnisight.pipeline.two_views.stereo_rig import load_pair
from omnisight.pipeline.two_views.two_view_options import StereoOptions
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.dense_stereo import DenseStereo, dense_stereo
from omnisight.twoview.motion_model import largest_sigma_deg
from omnisight.twoview.rectification import Rectification, rectify
from omnisight.twoview.relative_pose import estimate_relative_pose

Array = NDArray[np.float64]

# Smallest distance by default, in baselines: the largest parallax is then 19 degrees.
MIN_DISTANCE_BASELINES = 3.0
# Standard deviation of disparities, px: on rendered pairs 0.13 (room, 360 images) to 0.27 (street, fisheye and mirror).
DISPARITY_SIGMA_PX = 0.2
# Median row difference above which blocks do not match, and error of disparities that makes distances wrong, px.
MAX_ROW_DIFFERENCE_PX, MAX_ROTATION_PX = 1.0, 1.0
# Share of matched points nearer than the smallest distance above which this causes a warning: some of them are wrong.
MAX_NEAR_SHARE = 0.05
# Difference, standard deviations, of the pose of the rig from that of the images above which they contradict.
POSE_SIGMA = 4.0


class RigCheck(NamedTuple):
    """How well the images agree with the rig, measured on matched keypoints.

    Attributes
    ----------
    keypoints
        Numbers of keypoints of both images.
    matches, inliers
        Numbers of matches, and of those that agree with some relative pose, whether or not it is that of the rig.
    row_deg, row_px
        Median absolute row difference of the inliers in the rectified images: the angle between a keypoint and the
        epipolar half-plane of its match. NaN without inliers.
    disparity_px
        Their median disparity.
    near, nearest
        Number of inliers that are nearer than the smallest distance of the rectification, and the distance that 99 % of
        all inliers exceed.
    rotation_deg, rotation_sigma_deg
        Angle between the rotation of the rig and the one that the images determine, and the standard deviation of the
        latter about its most uncertain axis.
    rotation_px
        Error of disparities if the rotation of the rig is wrong by this angle.
    direction_deg, direction_sigma_deg
        Angle between the baseline of the rig and the direction of translation that the images determine, and the
        standard deviation of the latter along its most uncertain axis.
    direction_px
        Error of the median disparity if the baseline is wrong by this angle.
    reason
        Why there are no inliers; empty otherwise.
    """

    keypoints: tuple[int, int]
    matches: int
    inliers: int = 0
    row_deg: float = float("nan")
    row_px: float = float("nan")
    disparity_px: float = float("nan")
    near: int = 0
    nearest: float = float("nan")
    rotation_deg: float = float("nan")
    rotation_sigma_deg: float = float("nan")
    rotation_px: float = float("nan")
    direction_deg: float = float("nan")
    direction_sigma_deg: float = float("nan")
    direction_px: float = float("nan")
    reason: str = ""

    __repr__ = named_tuple_text

    @property
    def warning(self) -> str:
        """Warning that the images contradict the rig; empty if they do not."""
        rotated = self.rotation_px > MAX_ROTATION_PX and self.rotation_deg > POSE_SIGMA * self.rotation_sigma_deg
        displaced = (
            self.direction_px > DISPARITY_SIGMA_PX and self.direction_deg > POSE_SIGMA * self.direction_sigma_deg
        )
        if not (self.row_px > MAX_ROW_DIFFERENCE_PX or rotated or displaced):
            return ""
        return (
            "the images contradict the rig, and distances may be wrong or missing: after rectification matched"
            f" points differ by {self.row_px:.1f} rows ({self.row_deg:.2f}°, median), and the images determine a"
            f" rotation of the cameras that is {self.rotation_deg:.2f}° ± {self.rotation_sigma_deg:.2f}° from that of"
            f" the rig and a baseline that is {self.direction_deg:.1f}° ± {self.direction_sigma_deg:.1f}° from its"
            " baseline. Check that the cameras of the rig took both images at the same time, and calibrate the rig"
            " again if a camera was moved or refocused"
        )


@dataclass(frozen=True, eq=False)
class StereoResult(Displayed):
    """Distances from a stereo pair; false if there are none.

    Attributes
    ----------
    photos
        The left and the right image with their cameras.
    right_from_left
        Pose of the cameras, x_right = R x_left + t.
    rectification
        The rectification, which maps the images to `rectified`.
    rectified
        Both rectified images.
    dense
        Distances and standard deviations in the pixels of the left image, and disparities in the left rectified image.
    check
        How well the images agree with the rig.
    seconds
        Time of the whole computation.
    reason
        Why there are no distances; empty otherwise.
    unit
        Unit of lengths, that of the rig: "m" or "squares" of the board.
    """

    photos: tuple[Photo, Photo] = field(repr=False)
    right_from_left: Pose
    rectification: Rectification
    rectified: tuple[NDArray[Any], NDArray[Any]] = field(repr=False)
    dense: DenseStereo = field(repr=False)
    check: RigCheck
    seconds: float
    reason: str = ""
    unit: str = "m"

    def __bool__(self) -> bool:
        """Return whether there are distances."""
        return not self.reason

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that the images contradict the rig, or show objects that are nearer than the smallest distance."""
        return tuple(text for text in (self.check.warning, self._near_warning) if text)

    @property
    def _near_warning(self) -> str:
        check, nearest = self.check, self.rectification.min_distance
        if not check.near > MAX_NEAR_SHARE * check.inliers:
            return ""
        return (
            f"{check.near / check.inliers:.0%} of {check.inliers} matched points are nearer than {nearest:.3g}"
            f" {self.unit}, the smallest distance that is searched: near objects have wrong or no distances. Specify a"
            f" smaller one, such as --min-distance {0.8 * check.nearest:.2g}"
        )

    @property
    def distance(self) -> NDArray[np.float32]:
        """Distances (H, W) along the bearings of the left image from the left camera; NaN where unknown."""
        return self.dense.distance

    @property
    def sigma(self) -> NDArray[np.float32]:
        """Standard deviations (H, W) of the distances."""
        return self.dense.sigma

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Which pixels (H, W) of the left image have a distance."""
        return np.isfinite(self.distance)

    @cached_property
    def quantiles(self) -> tuple[float, float, float]:
        """The 1 %, 50 % and 99 % quantiles of the distances."""
        low, median, high = np.quantile(self.distance[self.known], [0.01, 0.5, 0.99])
        return float(low), float(median), float(high)

    @property
    def share(self) -> float:
        """Share of the used pixels of the left image that have a distance."""
        return float(self.known.sum() / self.rectification.masks[0].sum())

    def points(self) -> tuple[Array, NDArray[np.uint8]]:
        """Return the points (N, 3) in the frame of the left camera, and their colours (N, 3), RGB."""
        rows, columns = np.nonzero(self.known)
        left = self.photos[0]
        pixels = np.stack([columns, rows], -1).astype(float)
        bearings, valid = left.camera.unproject(pixels)
        points = bearings * self.distance[rows, columns, None]
        return points[valid], colors_at(left.image, pixels[valid])


def stereo(
    left: ImageSource, right: ImageSource, rig: RigSource, options: StereoOptions = StereoOptions()
) -> StereoResult:
    """Compute the distances of the pixels of the left image from two simultaneous images of a rig.

    The cameras may be of any central model, also of different ones. Both images are mapped to spheres whose poles lie
    on the baseline, rows are matched by semi-global matching, and disparities become distances along the bearings of
    the left camera. Distances with a large standard deviation, such as those near the baseline, are left out.

    Parameters
    ----------
    left, right
        The images, or their files. Any camera of the rig can be the left one.
    rig
        The rig, or its file.
    options
        Options of the command.

    Returns
    -------
    The result, which is false with a reason if the images are identical, exchanged, or show nothing in common.

    Raises
    ------
    ValueError
        If a file cannot be read, the rig does not determine two central cameras in different places that see a common
        direction, or an image or a mask does not have the size of its camera.
    """
    start = time.perf_counter()
    photos, right_from_left, unit = load_pair((left, right), rig, options)
    masks = _used_pixels(photos[0]), _used_pixels(photos[1])
    cameras = photos[0].camera, photos[1].camera
    baseline = float(np.linalg.norm(right_from_left.translation))
    nearest = MIN_DISTANCE_BASELINES * baseline if options.min_distance is None else options.min_distance
    rectification = rectify(cameras, right_from_left, nearest, masks)
    check = _check_rig(photos, right_from_left, rectification, options.seed)
    (image_a, seen_a), (image_b, seen_b) = (rectification.remap(p.image, k) for k, p in enumerate(photos))
    gray = to_gray8(image_a), to_gray8(image_b)
    dense = dense_stereo(rectification, gray, (seen_a, seen_b), _disparity_sigma(check), options.max_sigma)
    reason = _failure(photos, check, dense)
    rectified, seconds = (image_a, image_b), time.perf_counter() - start
    return StereoResult(photos, right_from_left, rectification, rectified, dense, check, seconds, reason, unit)


def _used_pixels(photo: Photo) -> NDArray[np.bool_]:
    """Return which pixels (H, W) show the scene and are allowed by the mask."""
    shown = illuminated_region(to_gray8(photo.image), photo.camera)
    return shown if photo.mask is None else shown & photo.mask


def _check_rig(photos: tuple[Photo, Photo], pose: Pose, rectification: Rectification, seed: int) -> RigCheck:
    """Compare the rig with matched keypoints, whose outliers are rejected without the pose of the rig."""
    a, b = (detect_features(p.image, p.camera, mask=m) for p, m in zip(photos, rectification.masks, strict=True))
    matches = match_features(a, b)
    check = RigCheck((len(a), len(b)), len(matches))
    a, b = a[matches.pairs[:, 0]], b[matches.pairs[:, 1]]
    pairs = BearingPairs.of(a.bearings, b.bearings, a.covariance, b.covariance, None)
    found = estimate_relative_pose(replace(pairs, is_noise_known=False), RansacOptions(seed=seed))
    if found.b_from_a is None:
        return check._replace(reason=found.reason)
    parallax, across = rectification.differences(a.bearings[found.inliers], b.bearings[found.inliers]).T
    row, px_per_rad = float(np.median(np.abs(across))), rectification.px_per_rad
    rotation = float(np.linalg.norm(so3.log(found.b_from_a.rotation @ pose.rotation.T)))
    disparity = float(np.median(parallax)) * px_per_rad
    largest = np.clip(np.quantile(parallax, 0.99), 0.0, np.pi / 2)
    # A displacement of the cameras across the baseline, by a share of it, changes disparities by up to this share.
    moved, baseline = found.b_from_a.translation, pose.translation / np.linalg.norm(pose.translation)
    direction = float(angle_between(moved, baseline)) if moved.any() else np.nan
    return check._replace(
        inliers=int(found.inliers.sum()),
        row_deg=float(np.degrees(row)),
        row_px=row * px_per_rad,
        disparity_px=disparity,
        near=int(np.sum(parallax * px_per_rad > rectification.max_disparity)),
        nearest=float(rectification.baseline / np.sin(largest)),
        rotation_deg=float(np.degrees(rotation)),
        rotation_sigma_deg=largest_sigma_deg(found.covariance[:3, :3]),
        rotation_px=rotation * px_per_rad,
        direction_deg=float(np.degrees(direction)),
        direction_sigma_deg=largest_sigma_deg(found.covariance[3:, 3:]),
        direction_px=np.sin(direction) * disparity,
    )


def _disparity_sigma(check: RigCheck) -> float:
    """Return the standard deviation of disparities: errors of the calibration act along rows as well as across."""
    return max(DISPARITY_SIGMA_PX, np.nan_to_num(check.row_px) / NORMAL_MEDIAN)


def _failure(photos: tuple[Photo, Photo], check: RigCheck, dense: DenseStereo) -> str:
    """Return why the pair has no distances; empty if it has."""
    left, right = photos
    if left.camera.size == right.camera.size and np.array_equal(left.image, right.image):
        return "the images are identical; specify the image of the other camera"
    for photo, count in zip(photos, check.keypoints, strict=True):
        if count < MIN_KEYPOINTS:
            return f"{photo.label} has {count} keypoints: it shows no texture that could be matched"
    if check.reason:
        return (
            f"the images show nothing in common ({check.reason}): specify images that the cameras of the rig took at"
            " the same time"
        )
    if check.disparity_px < -MAX_ROW_DIFFERENCE_PX:
        return (
            "the images are exchanged, or not of this rig: matched points have negative distances (median disparity"
            f" {check.disparity_px:.1f} px)"
        )
    if not np.isfinite(dense.distance).any():
        return check.warning or "no pixel has a distance: all points are too far for the baseline, or not matched"
    return ""
