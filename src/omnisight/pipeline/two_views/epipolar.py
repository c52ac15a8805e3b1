"""Epipolar geometry of two images: the counterpart of `omnisight epipolar`."""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.features import FeatureOptions, Keypoints, Matches, detect_features, match_features
from omnisight.geometry.pose import Pose
from omnisight.images import read_mask
from omnisight.optim.ransac import RansacOptions
from omnisight.pipeline.inputs.central_camera import CameraSource, camera_of_image
from omnisight.pipeline.inputs.photo import MIN_KEYPOINTS, ImageSource, Photo, read_source
from omnisight.pipeline.two_views.two_view_options import EpipolarOptions
from omnisight.sfm.missing_matches import missing_matches, predicted_matches_of_edge, repeatability
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.motion_model import MotionModel, largest_sigma_deg
from omnisight.twoview.relative_pose import RelativePose, estimate_relative_pose

Array = NDArray[np.float64]

# Excess, standard deviations, of matches of mirror images over the others if a frame is reflected: the counts are of
# 4000 keypoints, and the level 1e-5 leaves room for scenes that are nearly symmetric.
MIN_MIRRORED_SIGMA = 4.26


@dataclass(frozen=True, eq=False)
class EpipolarResult(Displayed):
    """The epipolar geometry of two images; false if none was found.

    Attributes
    ----------
    photos
        Both images with their cameras.
    keypoints
        Keypoints of both images.
    matches
        Matches of the keypoints.
    pose
        The relative pose with its covariance, and the inliers of the matches.
    motion
        The motion model, see `MotionModel`; "no overlap" or "ambiguous" if nothing was found.
    seconds
        Time of the whole computation.
    reason
        Why nothing was found; empty otherwise.
    """

    photos: tuple[Photo, Photo]
    keypoints: tuple[Keypoints, Keypoints] = field(repr=False)
    matches: Matches
    pose: RelativePose
    motion: MotionModel
    seconds: float
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether a pose was found."""
        return self.b_from_a is not None

    @property
    def b_from_a(self) -> Pose | None:
        """Pose of the cameras, x_b = R x_a + t, with t of unit length or zero; None if nothing was found."""
        return None if self.reason else self.pose.b_from_a

    @property
    def has_translation(self) -> bool:
        """Whether a pose was found that is not a rotation only."""
        return self.b_from_a is not None and bool(self.b_from_a.translation.any())

    @property
    def matched(self) -> tuple[Keypoints, Keypoints]:
        """Keypoints of the matches, in both images."""
        a, b = self.keypoints
        return a[self.matches.pairs[:, 0]], b[self.matches.pairs[:, 1]]

    @property
    def sigma_rotation_deg(self) -> float:
        """Standard deviation of the rotation about its most uncertain axis, degrees."""
        return largest_sigma_deg(self.pose.covariance[:3, :3])

    @property
    def sigma_direction_deg(self) -> float:
        """Standard deviation of the direction of the translation along its most uncertain axis, degrees."""
        return largest_sigma_deg(self.pose.covariance[3:, 3:])

    @property
    def parallax_deg(self) -> float:
        """Median angle between the rays of the inliers, degrees; NaN if nothing was found."""
        if self.b_from_a is None:
            return float("nan")
        a, b = (keypoints.bearings[self.pose.inliers] for keypoints in self.matched)
        chord = np.linalg.norm(a @ self.b_from_a.rotation.T - b, axis=1)
        return float(np.degrees(np.median(2 * np.arcsin(np.minimum(chord / 2, 1.0)))))

    @property
    def median_residual_deg(self) -> float:
        """Median angle of the inliers of the second image from their epipolar curves, degrees; NaN as above.

        For a rotation only, the curve is a point.
        """
        if self.b_from_a is None or not self.has_translation:
            return self.parallax_deg
        a, b = (keypoints.bearings[self.pose.inliers] for keypoints in self.matched)
        normals = np.cross(self.b_from_a.translation, a @ self.b_from_a.rotation.T)
        sine = np.abs((normals * b).sum(1)) / np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
        return float(np.degrees(np.median(np.arcsin(np.minimum(sine, 1.0)))))


def epipolar(
    image_a: ImageSource,
    image_b: ImageSource,
    camera_a: CameraSource | None = None,
    camera_b: CameraSource | None = None,
    options: EpipolarOptions = EpipolarOptions(),
) -> EpipolarResult:
    """Estimate the relative pose of two images of any cameras from matched features.

    Features are not matched again along the epipolar curves: such matches confirm the pose from which the curves are,
    which makes its estimate no better, and its standard deviation too small.

    Parameters
    ----------
    image_a, image_b
        The images, or their files.
    camera_a
        The camera of the first image, or its calibration file of any format. It may be omitted for an equirectangular
        image of 360° x 180°, which is twice as wide as high.
    camera_b
        The camera of the second image; by default that of the first.
    options
        Options of the command.

    Returns
    -------
    The result, which is false with a reason if the images are identical, have no texture or do not overlap.

    Raises
    ------
    ValueError
        If a file cannot be read, or a camera or mask does not fit its image.
    """
    start = time.perf_counter()
    a, b = _load_photos((image_a, image_b), (camera_a, camera_b), options)
    features = FeatureOptions(options.features, max_keypoints=options.max_keypoints)
    of_a, of_b = (detect_features(p.image, p.camera, features, mask=p.mask) for p in (a, b))
    matches = match_features(of_a, of_b)
    pose = estimate_relative_pose(_pairs(of_a, of_b, matches), RansacOptions(seed=options.seed))
    reason = (
        _reflection((a, b), of_a, len(matches), features)
        or _failure((a, b), (of_a, of_b), pose)
        or _lack_of_matches((of_a, of_b), matches, pose)
    )
    motion = pose.motion if not reason or pose.motion.name == "ambiguous" else MotionModel("no overlap", reason)
    return EpipolarResult((a, b), (of_a, of_b), matches, pose, motion, time.perf_counter() - start, reason)


def _pairs(a: Keypoints, b: Keypoints, matches: Matches) -> BearingPairs:
    """Return the bearings of matches, with the covariances of the keypoints up to a factor.

    The factor holds the errors of the calibration and of the surroundings of keypoints that the motion changes.
    """
    a, b = a[matches.pairs[:, 0]], b[matches.pairs[:, 1]]
    pairs = BearingPairs.of(a.bearings, b.bearings, a.covariance, b.covariance, None)
    return replace(pairs, is_noise_known=False)


def _reflection(photos: tuple[Photo, Photo], of_a: Keypoints, match_count: int, options: FeatureOptions) -> str:
    """Return that the frame of one of two different cameras is reflected; empty if their images match as they are.

    Boards without markers do not determine whether a camera looks into a mirror, and few wrong matches may agree with
    a pose. Images of one camera match in a reflected frame too, and so do their poses.
    """
    a, b = photos
    if a.camera.model == b.camera.model:
        return ""
    mirrored = len(match_features(of_a, detect_features(b.image, b.camera, options, mask=b.mask, mirrored=True)))
    if mirrored - match_count <= MIN_MIRRORED_SIGMA * np.sqrt(mirrored + match_count):
        return ""
    blind = [photo.label for photo in photos if photo.camera.theta_min > 0]
    which = f"the camera of {blind[0]}" if len(blind) == 1 else "the camera that looks into a mirror"
    return (
        f"the frame of one camera is reflected: {mirrored} keypoints match the mirror image, {match_count} the image."
        f" Boards without markers do not determine that; convert {which} with omnisight convert --to native --flip"
    )


def _failure(photos: tuple[Photo, Photo], keypoints: tuple[Keypoints, Keypoints], pose: RelativePose) -> str:
    """Return why the images have no epipolar geometry; empty if they have."""
    a, b = photos
    if a.camera.size == b.camera.size and np.array_equal(a.image, b.image):
        return "the images are identical and do not determine a motion; take the second from another place"
    for photo, found in zip(photos, keypoints, strict=True):
        if photo.mask is not None and not photo.mask.any():
            return f"the mask of {photo.label} excludes all of its pixels; paint the areas to use white"
        if len(found) < MIN_KEYPOINTS:
            return f"{photo.label} has {len(found)} keypoints: it shows no texture in the field of view of its camera"
    if pose:
        return ""
    return f"{'the pose is ambiguous' if pose.motion.name == 'ambiguous' else 'no overlap was found'}: {pose.reason}"


def _lack_of_matches(keypoints: tuple[Keypoints, Keypoints], matches: Matches, pose: RelativePose) -> str:
    """Return why a pose is wrong, if the images would have far more matches from there; empty otherwise."""
    assert pose.b_from_a is not None
    edge = Edge(0, 1, pose.b_from_a, pose.covariance, pose.motion.name, matches.pairs[pose.inliers])
    prediction = predicted_matches_of_edge(edge, keypoints)
    if not missing_matches([prediction], repeatability([edge.images], [prediction]))[0]:
        return ""
    return (
        f"the pose lacks matches: from there, both images would show {prediction.predicted:.0f} keypoints, and "
        f"{prediction.found:.0f} match; they are of structures that repeat"
    )


def _load_photos(
    images: tuple[ImageSource, ImageSource],
    cameras: tuple[CameraSource | None, CameraSource | None],
    options: EpipolarOptions,
) -> tuple[Photo, Photo]:
    """Read images, cameras and masks."""
    same_camera = cameras[1] is None and options.name_b is None
    mask_b = options.mask_b or (options.mask if same_camera else None)
    name_b = options.name_b or (options.name if same_camera else None)
    a = _load_photo(images[0], "first image", cameras[0], (options.name, "--name"), options)
    b = _load_photo(images[1], "second image", cameras[1] or cameras[0], (name_b, "--name-b"), options)
    return _with_mask(a, options.mask), _with_mask(b, mask_b)


def _load_photo(
    source: ImageSource,
    default_label: str,
    camera: CameraSource | None,
    name_option: tuple[str | None, str],
    options: EpipolarOptions,
) -> Photo:
    label, image = read_source(source, default_label, options.apply_exif)
    size, (name, option) = (image.shape[1], image.shape[0]), name_option
    fitted = camera_of_image(camera, size, label, name=name, option=option, scale=options.scale_camera)
    return Photo(label, image, fitted, None)


def _with_mask(photo: Photo, mask: Path | None) -> Photo:
    return photo if mask is None else photo._replace(mask=read_mask(mask, photo.camera.size))
