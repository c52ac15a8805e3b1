"""Calibration of a head of two lenses from what both see at their rims, and from its motion between frames.

The overlap alone determines the angle sum theta_a(r_a) + theta_b(r_b) at the rim, and with it the focal length and the
rotation, but not the slope of the profile there: the profile is known as well as its prior. If the head moves, the
epipolar constraint of the whole sphere between consecutive frames determines it too.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import Keypoints
from omnisight.geometry import rotation as so3
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optim.loss import NORMAL_MEDIAN, robust_sigma
from omnisight.sfm.head_matches import OverlapMatches, best_rotation, detect_in_lenses, match_frames, match_overlap
from omnisight.sfm.head_problem import (
    CAUCHY_SIGMA,
    K1_MEAN,
    K1_SIGMA,
    K2_SIGMA,
    LENS_PARAMETERS,
    OVERLAP_PARAMETERS,
    ROTATION,
    TRANSLATION,
    HeadMotion,
    HeadProblem,
    LensField,
    lens_bearings,
)
from omnisight.sfm.head_result import FrameAgreement, HeadCalibration
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.relative_pose import estimate_relative_pose

Array = NDArray[np.float64]

# Fields of view of the image circle that are tried, degrees.
FIELDS_OF_VIEW = tuple(range(160, 241, 5))
# The overlap is searched for beyond this share of the radius of the image circle: 60 degrees of a lens of 180.
RIM_SHARE = 0.66
# Largest angle between matches after the rotation: parallax of a baseline of 3 cm at 1 m, and errors of the guess.
TOLERANCE_RAD = float(np.radians(2.0))
# Fewer matches determine no rotation and lenses: twice the parameters of the overlap.
MIN_OVERLAP_MATCHES = 16
# Matches between frames used for each pair of frames and lens: more do not change the result.
MAX_FRAME_MATCHES = 400
# Matches between frames that determine a motion, and their median displacement; with less, the head is at rest.
MIN_MOTION_MATCHES, MIN_MOTION_RAD = 50, float(np.radians(0.5))
# Standard deviation of bearings that is assumed to estimate a motion, and those of the residuals at the start.
BEARING_SIGMA_RAD, OVERLAP_SIGMA_RAD, MOTION_SIGMA_RAD = float(np.radians(0.1)), TOLERANCE_RAD / 3, 3e-3
# Typical changes of the parameters of a lens (`LENS_PARAMETERS`), and of angles, radians; and steps of differences
# relative to them.
LENS_SCALES, ANGLE_SCALE, DIFFERENCE_STEP = (0.05, 0.03, 0.006, 3.0, 3.0), 0.02, 1e-4
# Those of the profiles of both lenses.
PROFILE_PARAMETERS = [1, 2, LENS_PARAMETERS + 1, LENS_PARAMETERS + 2]
# Rounds of the reweighted rotation.
ROUNDS = 20
# Covariance of a calibration that failed.
UNKNOWN = np.full((OVERLAP_PARAMETERS, OVERLAP_PARAMETERS), np.nan)


def calibrate_head(
    images: Sequence[tuple[NDArray[Any], NDArray[Any]]],
    fields: tuple[LensField, LensField],
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
) -> HeadCalibration:
    """Estimate the lenses of a head and their relative rotation from simultaneous images.

    Parameters
    ----------
    images
        The images of both lenses, for each frame.
    fields
        The image fields of both lenses.
    masks
        (H, W) which pixels to use.

    Returns
    -------
    The calibration; false with a reason if too few matches agree with a rotation.
    """
    guesses = [tuple(_guess(lens, fov) for lens in fields) for fov in FIELDS_OF_VIEW]
    middle = guesses[FIELDS_OF_VIEW.index(190)]
    keypoints = detect_in_lenses(images, middle, masks)
    overlap = match_overlap([(_at_rim(a, fields[0]), _at_rim(b, fields[1])) for a, b in keypoints])
    rng = np.random.default_rng(0)
    trials = [_rotation_of(cameras, overlap, rng) for cameras in guesses]
    best = int(np.argmax([inliers.sum() for _, inliers in trials]))
    rotation, inliers = trials[best]
    cameras = (guesses[best][0], guesses[best][1])
    if inliers.sum() < MIN_OVERLAP_MATCHES:
        reason = (
            f"only {int(inliers.sum())} of {len(overlap)} matches at the rims agree with a rotation, at least"
            f" {MIN_OVERLAP_MATCHES} are needed"
        )
        return HeadCalibration(cameras, rotation, np.zeros(3), UNKNOWN, int(inliers.sum()), np.nan, (), reason)
    overlap = overlap.select(inliers)
    motions = _motions(keypoints, cameras, rotation)
    sigmas = (fields[0].center_sigma, fields[1].center_sigma)
    problem = HeadProblem(cameras, sigmas, rotation, overlap, motions, OVERLAP_SIGMA_RAD, MOTION_SIGMA_RAD)
    return _solve(problem, len(images))


def _solve(problem: HeadProblem, frames: int) -> HeadCalibration:
    """Minimize in two rounds, the second with the residuals' own scale, and compare with single frames."""
    x = _minimize(problem, np.zeros(problem.size))
    problem = _rescaled(problem, x)
    x = _minimize(problem, x)
    covariance = _covariance(problem, x)[:OVERLAP_PARAMETERS, :OVERLAP_PARAMETERS]
    agreement = _single_frames(problem, x, covariance) if frames > 1 else ()
    sigma_deg = float(np.degrees(problem.sigma))
    return HeadCalibration(
        problem.cameras(x),
        problem.rotation_at(x),
        x[TRANSLATION],
        covariance,
        len(problem.overlap),
        sigma_deg,
        agreement,
    )


def _minimize(problem: HeadProblem, x: Array, *, with_profile: bool = True) -> Array:
    """Return the parameters of least cost, near x; without the profile, it is that of the prior."""
    from scipy.optimize import least_squares  # imported on use: scipy is slow to import

    x, free = x.copy(), np.ones(problem.size, bool)
    if not with_profile:
        x[PROFILE_PARAMETERS], free[PROFILE_PARAMETERS] = 0.0, False

    def residuals(values: Array) -> Array:
        at = x.copy()
        at[free] = values
        return problem.residuals(at)

    x[free] = least_squares(residuals, x[free], x_scale=_scales(problem)[free], max_nfev=30, xtol=1e-6).x
    return x


def _scales(problem: HeadProblem) -> Array:
    """Return the typical changes of the parameters."""
    return np.array([*LENS_SCALES, *LENS_SCALES, *[ANGLE_SCALE] * (problem.size - 2 * LENS_PARAMETERS)])


def _rescaled(problem: HeadProblem, x: Array) -> HeadProblem:
    """Return the problem with the standard deviations of its residuals."""
    sigma = robust_sigma(problem.distances(x))
    values = problem.epipolar_residuals(x)
    scale = float(np.median(np.abs(np.concatenate(values)))) / NORMAL_MEDIAN if values else 1.0
    return dataclasses.replace(problem, sigma=max(sigma, 1e-4), motion_sigma=max(problem.motion_sigma * scale, 1e-4))


def _covariance(problem: HeadProblem, x: Array) -> Array:
    """Return the covariance at the solution, with the correlation of its residuals (sandwich estimator).

    The overlap of a head at rest determines the radius of 90 degrees, but hardly the profile of the lenses: parallax
    changes its matches like another profile. Without motions, the variance of the prior is therefore added along the
    changes of the profile that keep this radius and are the same for both lenses, and the squared difference from the
    solution with the profile of the prior: from six single frames of a real head with parallax, focal lengths then
    differ from that of all frames by 1.9 standard deviations at most, and by 3.5 with the first term alone.
    """
    scales, base = _scales(problem) * DIFFERENCE_STEP, problem.residuals(x)
    jacobian = np.stack([(problem.residuals(x + step) - base) / step.sum() for step in np.diag(scales)], -1)
    inverse = np.asarray(np.linalg.inv(jacobian.T @ jacobian), float)
    correlated = jacobian * problem.correlations()[:, None]
    covariance = inverse @ (correlated.T @ correlated) @ inverse
    if problem.motions:
        return covariance
    theta, power = np.pi / 2, np.array([3.0, 5.0])  # r = f (theta + k1 theta^3 + k2 theta^5)
    changes = np.zeros((2, problem.size))
    for lens, camera in enumerate(problem.cameras(x)):
        values = camera.model.to_dict()
        radius = theta + values["k1"] * theta**3 + values["k2"] * theta**5
        changes[:, LENS_PARAMETERS * lens] = -(theta**power) / radius
        changes[:, LENS_PARAMETERS * lens + 1 : LENS_PARAMETERS * lens + 3] = np.eye(2)
    difference = x - _minimize(problem, x, with_profile=False)
    return covariance + changes.T @ np.diag([K1_SIGMA**2, K2_SIGMA**2]) @ changes + np.outer(difference, difference)


def _single_frames(problem: HeadProblem, x: Array, covariance: Array) -> tuple[FrameAgreement, ...]:
    """Estimate rotation and focal lengths from the overlap of each frame alone."""
    joint = problem.rotation_at(x)
    rim = _rim_sum(problem, problem.cameras(x))
    found: list[FrameAgreement] = []
    for frame in np.unique(problem.overlap.frame):
        rows = problem.overlap.frame == frame
        if rows.sum() < MIN_OVERLAP_MATCHES:
            continue
        alone = dataclasses.replace(problem, overlap=problem.overlap.select(rows), motions=[])
        y = _minimize(alone, x[:OVERLAP_PARAMETERS])
        own = _covariance(alone, y)
        angle = np.degrees(np.linalg.norm(so3.log(alone.rotation_at(y) @ joint.T)))
        rotation_sigma = np.degrees(np.sqrt(np.trace((own + covariance)[ROTATION, ROTATION])))
        gradient = _rim_gradient(alone, y)
        rim_sigma = np.degrees(np.sqrt(gradient @ own @ gradient + gradient @ covariance @ gradient))
        difference = np.degrees(_rim_sum(alone, alone.cameras(y)) - rim)
        found.append(
            FrameAgreement(int(rows.sum()), float(angle), float(rotation_sigma), float(difference), float(rim_sigma))
        )
    return tuple(found)


def _rim_sum(problem: HeadProblem, cameras: Sequence[Camera]) -> float:
    """Return the sum of both lenses' angles at the median radii of the matches, which the overlap determines."""
    total = 0.0
    for start, camera, pixels in zip(
        problem.start, cameras, (problem.overlap.first, problem.overlap.other), strict=True
    ):
        model, own = start.model, camera.model
        radius = float(np.median(np.linalg.norm(pixels - [model.cx, model.cy], axis=1)))  # pyright: ignore
        bearing, _ = camera.unproject([own.cx + radius, own.cy])  # pyright: ignore
        total += float(np.arctan2(np.hypot(bearing[0], bearing[1]), bearing[2]))
    return total


def _rim_gradient(problem: HeadProblem, x: Array) -> Array:
    """Return the derivatives of the sum of angles at the rim by the parameters of the overlap."""
    scales, base = _scales(problem)[:OVERLAP_PARAMETERS] * DIFFERENCE_STEP, _rim_sum(problem, problem.cameras(x))
    return np.array([(_rim_sum(problem, problem.cameras(x + step)) - base) / step.sum() for step in np.diag(scales)])


def _motions(
    keypoints: Sequence[Sequence[Keypoints]], cameras: tuple[Camera, Camera], rotation: Array
) -> list[HeadMotion]:
    """Return the motions of the head between frames, with their inliers."""
    motions: list[HeadMotion] = []
    for _, _, lenses in match_frames(keypoints):
        to_first = (np.eye(3), rotation)
        before, after = (
            np.concatenate(
                [lens_bearings(c, pixels[k]) @ r for c, pixels, r in zip(cameras, lenses, to_first, strict=True)]
            )
            for k in range(2)
        )
        displacement = np.linalg.norm(before - after, axis=1)
        if len(before) < MIN_MOTION_MATCHES or np.median(displacement) < MIN_MOTION_RAD:
            continue
        assumed = np.broadcast_to(np.eye(3) * BEARING_SIGMA_RAD**2, (len(before), 3, 3))
        pose = estimate_relative_pose(BearingPairs.of(before, after, assumed, assumed, None))
        if pose.b_from_a is None or pose.inliers.sum() < MIN_MOTION_MATCHES:
            continue
        split = np.split(pose.inliers, [len(lenses[0][0])])
        kept = [
            (a[rows][:MAX_FRAME_MATCHES], b[rows][:MAX_FRAME_MATCHES])
            for (a, b), rows in zip(lenses, split, strict=True)
        ]
        motion = pose.b_from_a
        turned, seen = before[pose.inliers] @ motion.rotation.T, after[pose.inliers]
        # The law of sines in the triangle of both positions and a point.
        sines = (np.linalg.norm(np.cross(x, seen), axis=1) for x in (motion.translation, turned))
        distance = float(np.median(np.divide(*sines)))
        motions.append(HeadMotion(motion.rotation, motion.translation, distance, kept))
    return motions


def _rotation_of(
    cameras: Sequence[Camera], overlap: OverlapMatches, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the rotation from the first lens to the second, and its inliers (N,)."""
    a, b = lens_bearings(cameras[0], overlap.first), lens_bearings(cameras[1], overlap.other)
    return best_rotation(a, b, TOLERANCE_RAD, rng)


def _guess(lens: LensField, degrees: float) -> Camera:
    """Return the lens of a field of view, degrees, whose profile is that of the prior."""
    rim, (cx, cy) = np.radians(degrees / 2), lens.circle.centre
    focal = float(lens.circle.radius / (rim * (1 + K1_MEAN * rim**2)))
    return Camera(KannalaBrandt(focal, focal, cx, cy, K1_MEAN, 0.0, 0.0, 0.0), lens.field.size)


def _at_rim(keypoints: Keypoints, lens: LensField) -> Keypoints:
    """Return the keypoints that both lenses may see."""
    distance = np.linalg.norm(keypoints.pixels - lens.circle.centre, axis=1)
    return keypoints[distance > RIM_SHARE * lens.circle.radius]


def estimate_head_rotation(
    images: Sequence[tuple[NDArray[Any], NDArray[Any]]],
    cameras: tuple[Camera, Camera],
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
) -> HeadCalibration:
    """Estimate the relative rotation of two calibrated lenses from simultaneous images.

    Parameters
    ----------
    images, masks
        As in `calibrate_head`.
    cameras
        The lenses.
    """
    keypoints = detect_in_lenses(images, cameras, masks)
    return fit_head_rotation(cameras, match_overlap([(a, b) for a, b in keypoints]))


def fit_head_rotation(cameras: tuple[Camera, Camera], overlap: OverlapMatches) -> HeadCalibration:
    """Estimate the relative rotation of two calibrated lenses from matches of simultaneous images."""
    rotation, inliers = _rotation_of(cameras, overlap, np.random.default_rng(0))
    count = int(inliers.sum())
    if count < MIN_OVERLAP_MATCHES:
        reason = (
            f"only {count} of {len(overlap)} matches agree with a rotation, at least {MIN_OVERLAP_MATCHES} are needed"
        )
        return HeadCalibration(cameras, rotation, np.zeros(3), UNKNOWN, count, np.nan, (), reason)
    overlap = overlap.select(inliers)
    a, b = lens_bearings(cameras[0], overlap.first), lens_bearings(cameras[1], overlap.other)
    rotation, sigma, weight = _reweighted_rotation(a, b, rotation)
    covariance = np.zeros((OVERLAP_PARAMETERS, OVERLAP_PARAMETERS))
    covariance[ROTATION, ROTATION] = _rotation_covariance(a @ rotation.T, b, weight, sigma) * overlap.correlation
    return HeadCalibration(cameras, rotation, np.zeros(3), covariance, count, float(np.degrees(sigma)))


def _reweighted_rotation(a: Array, b: Array, rotation: Array) -> tuple[Array, float, Array]:
    """Return the rotation of bearings a to b (N, 3) with Cauchy weights, their standard deviation and weights (N,)."""
    sigma, weight = 0.0, np.ones(len(a))
    for _ in range(ROUNDS):
        distance = np.linalg.norm(a @ rotation.T - b, axis=1)
        sigma = max(robust_sigma(distance), 1e-4)
        weight = 1 / (1 + (distance / (CAUCHY_SIGMA * sigma)) ** 2)
        rotation = so3.nearest((b * weight[:, None]).T @ a)
    return rotation, sigma, weight


def _rotation_covariance(a: Array, b: Array, weight: Array, sigma: float) -> Array:
    """Return the covariance (3, 3) of a rotation from independent bearings (N, 3) with Cauchy weights (sandwich).

    `a` are the rotated bearings. The information is the second derivative of the robust cost, which is less than that
    of a cost with constant weights: 0.7 for 0.84 with normal errors.
    """
    gradient = np.cross(a, b) * weight[:, None]
    scatter = gradient.T @ gradient
    moment = (b * weight[:, None]).T @ a
    information = np.trace(moment) * np.eye(3) - (moment + moment.T) / 2 - 2 * scatter / (CAUCHY_SIGMA * sigma) ** 2
    inverse = np.linalg.inv(information)
    return np.asarray(inverse @ scatter @ inverse, float)
