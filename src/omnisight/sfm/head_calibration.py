"""Calibration of a head of two lenses from what both see at their rims, and from its motion between frames.

The overlap alone determines the angle sum theta_a(r_a) + theta_b(r_b) at the rim, and with it the focal length and the
rotation, but not the slope of the profile there: the profile is known as well as its prior. If the head moves, the
epipolar constraint of the whole sphere between consecutive frames determines it too.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import Keypoints
from omnisight.geometry import rotation as so3
from omnisight.images import ImageField
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.sfm.head_matches import OverlapMatches, best_rotation, detect_in_lenses, match_frames, match_overlap
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
# Prior of the profile: between equisolid (k1 = -0.042) and equidistant; standard deviations of k1 and k2.
K1_MEAN, K1_SIGMA, K2_SIGMA = -0.02, 0.03, 0.006
# Both lenses are of one design: standard deviations of the differences of logarithm of focal length, k1 and k2.
SAME_FOCAL, SAME_K1, SAME_K2 = 0.003, 0.003, 0.0006
# Parallax is common to neighbouring matches: an overlap has about as many independent ones in each frame.
INDEPENDENT_MATCHES = 30
# Standard deviation of the principal point about the centre of the image circle, as a share of its radius.
CENTER_SIGMA = 0.006
# Matches between frames used for each pair of frames and lens: more do not change the result.
MAX_FRAME_MATCHES = 400
# Parameters of a lens: logarithm of the focal length, k1, k2, cx, cy.
LENS_PARAMETERS = 5
# Quotient of the standard deviation and the median of the absolute value of a normal variable.
SIGMA_OF_MEDIAN = 1.4826


@dataclass(frozen=True)
class FrameAgreement:
    """Estimate from the overlap of one frame, against that from all.

    Attributes
    ----------
    matches
        Number of matches in the overlap.
    rotation_deg, rotation_sigma_deg
        Angle between the rotations, and its expected value from both uncertainties.
    rim_deg, rim_sigma_deg
        Difference of the sum of both lenses' angles at the rim, and its standard deviation.
    """

    matches: int
    rotation_deg: float
    rotation_sigma_deg: float
    rim_deg: float
    rim_sigma_deg: float


@dataclass(frozen=True, eq=False)
class HeadCalibration:
    """Lenses and rotation of a head; false if they cannot be estimated.

    Attributes
    ----------
    cameras
        Both lenses.
    rotation
        (3, 3) bearings of the first to the second.
    covariance
        (13, 13) of logarithm of the focal length, k1, k2, cx, cy of both lenses, and the rotation vector.
    matches
        Number of matches in the overlap that agree.
    sigma_deg
        Standard deviation of their residuals.
    frames
        Estimates from single frames; empty for one frame.
    reason
        Why the head cannot be calibrated.
    """

    cameras: tuple[Camera, Camera]
    rotation: Array
    covariance: Array
    matches: int
    sigma_deg: float
    frames: tuple[FrameAgreement, ...] = ()
    reason: str = ""

    def __bool__(self) -> bool:
        return not self.reason

    @property
    def rotation_sigma_deg(self) -> float:
        """Standard deviation of the rotation about its most uncertain axis."""
        return float(np.degrees(np.sqrt(np.linalg.eigvalsh(self.covariance[-3:, -3:])[-1])))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares over both lenses, the rotation, and the motions between frames."""

    start: tuple[Camera, Camera]
    radius: tuple[float, float]
    rotation: Array
    overlap: OverlapMatches
    motions: list[tuple[Array, Array, list[tuple[Array, Array]]]]
    sigma: float
    motion_sigma: float

    @property
    def size(self) -> int:
        return 2 * LENS_PARAMETERS + 3 + 5 * len(self.motions)

    def cameras(self, x: Array) -> tuple[Camera, Camera]:
        return _moved(self.start[0], x[:5]), _moved(self.start[1], x[5:10])

    def turned(self, x: Array) -> Array:
        return so3.exp(x[10:13]) @ self.rotation

    def residuals(self, x: Array) -> Array:
        """Return all residuals in standard deviations: overlap (2 N,), motions, priors."""
        cameras, rotation = self.cameras(x), self.turned(x)
        a, b = _bearings(cameras[0], self.overlap.first), _bearings(cameras[1], self.overlap.other)
        parts = [((a @ rotation.T - b) / self.sigma).ravel()]
        correlation = np.sqrt(max(1.0, len(a) / (INDEPENDENT_MATCHES * len(np.unique(self.overlap.frame)))))
        for k, (turn, shift, lenses) in enumerate(self.motions):
            step = x[13 + 5 * k : 18 + 5 * k]
            parts.append(self.epipolar(so3.exp(step[:3]) @ turn, _shifted(shift, step[3:]), lenses, cameras, rotation))
        robust = np.arctan(np.concatenate(parts) / 3) * 3
        robust[: 3 * len(a)] /= correlation
        return np.concatenate([robust, self._priors(x)])

    def epipolar(
        self,
        turn: Array,
        shift: Array,
        lenses: list[tuple[Array, Array]],
        cameras: tuple[Camera, Camera],
        rotation: Array,
    ) -> Array:
        """Return the angles between bearings and epipolar planes of the whole sphere."""
        angles: list[Array] = []
        for camera, (before, after), to_first in zip(cameras, lenses, (np.eye(3), rotation), strict=True):
            a, b = _bearings(camera, before) @ to_first, _bearings(camera, after) @ to_first
            normals = np.cross(shift, a @ turn.T)
            length = np.maximum(np.linalg.norm(normals, axis=1), 0.05)
            angles.append((normals * b).sum(1) / length / self.motion_sigma)
        return np.concatenate(angles)

    def _priors(self, x: Array) -> Array:
        parts: list[float] = []
        for lens, radius in enumerate(self.radius):
            log_f, k1, k2, cx, cy = x[5 * lens : 5 * lens + 5]
            model: Any = self.start[lens].model
            sigma = CENTER_SIGMA * radius
            parts += [(model.k1 + k1 - K1_MEAN) / K1_SIGMA, (model.k2 + k2) / K2_SIGMA, cx / sigma, cy / sigma]
            parts.append(log_f / 1.0)
        first, second = (camera.model for camera in self.cameras(x))
        parts.append(np.log(first.fx / second.fx) / SAME_FOCAL)  # pyright: ignore
        parts.append((first.k1 - second.k1) / SAME_K1)  # pyright: ignore
        parts.append((first.k2 - second.k2) / SAME_K2)  # pyright: ignore
        return np.array(parts)


def calibrate_head(
    images: Sequence[tuple[NDArray[Any], NDArray[Any]]],
    fields: tuple[ImageField, ImageField],
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]],
) -> HeadCalibration:
    """Estimate the lenses of a head and their relative rotation from simultaneous images.

    Parameters
    ----------
    images
        The images of both lenses, for each frame.
    fields
        The image fields of both lenses, with an image circle.
    masks
        (H, W) which pixels to use.

    Returns
    -------
    The calibration; false with a reason if too few matches agree with a rotation.
    """
    guesses = [tuple(_guess(field, fov) for field in fields) for fov in FIELDS_OF_VIEW]
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
        return HeadCalibration(cameras, rotation, np.full((13, 13), np.nan), int(inliers.sum()), np.nan, (), reason)
    overlap = overlap.select(inliers)
    motions = _motions(keypoints, cameras, rotation)
    radius = tuple(field.outer.radius if field.outer else 0.5 * max(field.size) for field in fields)
    problem = _Problem(cameras, (radius[0], radius[1]), rotation, overlap, motions, TOLERANCE_RAD / 3, 3e-3)
    return _solved(problem, len(images))


def _solved(problem: _Problem, frames: int) -> HeadCalibration:
    """Minimize in two rounds, the second with the residuals' own scale, and compare with single frames."""
    x = _minimize(problem, np.zeros(problem.size))
    problem = _rescaled(problem, x)
    x = _minimize(problem, x)
    covariance = _covariance(problem, x)[:13, :13]
    agreement = _single_frames(problem, x, covariance) if frames > 1 else ()
    sigma_deg = float(np.degrees(problem.sigma))
    return HeadCalibration(
        problem.cameras(x), problem.turned(x), covariance, len(problem.overlap), sigma_deg, agreement
    )


def _minimize(problem: _Problem, x: Array) -> Array:
    from scipy.optimize import least_squares  # imported on use: scipy is slow to import

    return np.asarray(least_squares(problem.residuals, x, x_scale=_scales(problem), max_nfev=30, xtol=1e-6).x)


def _scales(problem: _Problem) -> Array:
    lens = np.array([0.05, 0.03, 0.006, 3.0, 3.0])
    return np.concatenate([lens, lens, np.full(problem.size - 10, 0.02)])


def _rescaled(problem: _Problem, x: Array) -> _Problem:
    """Return the problem with the standard deviations of its residuals."""
    cameras, rotation = problem.cameras(x), problem.turned(x)
    a, b = _bearings(cameras[0], problem.overlap.first), _bearings(cameras[1], problem.overlap.other)
    sigma = float(np.median(np.linalg.norm(a @ rotation.T - b, axis=1)) / np.sqrt(2 * np.log(2)))
    values = [
        problem.epipolar(
            so3.exp(x[13 + 5 * k : 16 + 5 * k]) @ turn,
            _shifted(shift, x[16 + 5 * k : 18 + 5 * k]),
            lenses,
            cameras,
            rotation,
        )
        for k, (turn, shift, lenses) in enumerate(problem.motions)
    ]
    scale = SIGMA_OF_MEDIAN * float(np.median(np.abs(np.concatenate(values)))) if values else 1.0
    return dataclasses.replace(problem, sigma=max(sigma, 1e-4), motion_sigma=max(problem.motion_sigma * scale, 1e-4))


def _covariance(problem: _Problem, x: Array) -> Array:
    """Return the inverse of the normal equations at the solution."""
    scales, base = _scales(problem) * 1e-4, problem.residuals(x)
    jacobian = np.stack([(problem.residuals(x + step) - base) / step.sum() for step in np.diag(scales)], -1)
    return np.linalg.inv(jacobian.T @ jacobian)


def _single_frames(problem: _Problem, x: Array, covariance: Array) -> tuple[FrameAgreement, ...]:
    """Estimate rotation and focal lengths from the overlap of each frame alone."""
    joint = problem.turned(x)
    rim = _rim_sum(problem, problem.cameras(x))
    found: list[FrameAgreement] = []
    for frame in np.unique(problem.overlap.frame):
        rows = problem.overlap.frame == frame
        if rows.sum() < MIN_OVERLAP_MATCHES:
            continue
        alone = dataclasses.replace(problem, overlap=problem.overlap.select(rows), motions=[])
        y = _minimize(alone, x[:13])
        own = _covariance(alone, y)
        angle = np.degrees(np.linalg.norm(so3.log(alone.turned(y) @ joint.T)))
        rotation_sigma = np.degrees(np.sqrt(np.trace(own[10:, 10:] + covariance[10:, 10:])))
        gradient = _rim_gradient(alone, y)
        rim_sigma = np.degrees(np.sqrt(gradient @ own @ gradient + gradient @ covariance @ gradient))
        difference = np.degrees(_rim_sum(alone, alone.cameras(y)) - rim)
        found.append(
            FrameAgreement(int(rows.sum()), float(angle), float(rotation_sigma), float(difference), float(rim_sigma))
        )
    return tuple(found)


def _rim_sum(problem: _Problem, cameras: Sequence[Camera]) -> float:
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


def _rim_gradient(problem: _Problem, x: Array) -> Array:
    scales, base = _scales(problem)[:13] * 1e-4, _rim_sum(problem, problem.cameras(x))
    return np.array([(_rim_sum(problem, problem.cameras(x + step)) - base) / step.sum() for step in np.diag(scales)])


def _motions(
    keypoints: Sequence[Sequence[Keypoints]], cameras: tuple[Camera, Camera], rotation: Array
) -> list[tuple[Array, Array, list[tuple[Array, Array]]]]:
    """Return rotation, direction and inliers (pixels of each lens) of the motion of the head between frames."""
    motions: list[tuple[Array, Array, list[tuple[Array, Array]]]] = []
    for _, _, lenses in match_frames(keypoints):
        to_first = (np.eye(3), rotation)
        before, after = (
            np.concatenate(
                [_bearings(c, pixels[k]) @ r for c, pixels, r in zip(cameras, lenses, to_first, strict=True)]
            )
            for k in range(2)
        )
        if len(before) < 50 or np.median(np.linalg.norm(before - after, axis=1)) < np.radians(0.5):
            continue
        spread = np.broadcast_to(np.eye(3) * np.radians(0.1) ** 2, (len(before), 3, 3))
        pose = estimate_relative_pose(BearingPairs.of(before, after, spread, spread, None))
        if pose.b_from_a is None or pose.inliers.sum() < 50:
            continue
        split = np.split(pose.inliers, [len(lenses[0][0])])
        kept = [
            (a[rows][:MAX_FRAME_MATCHES], b[rows][:MAX_FRAME_MATCHES])
            for (a, b), rows in zip(lenses, split, strict=True)
        ]
        motions.append((pose.b_from_a.rotation, pose.b_from_a.translation, kept))
    return motions


def _rotation_of(
    cameras: Sequence[Camera], overlap: OverlapMatches, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    a, b = _bearings(cameras[0], overlap.first), _bearings(cameras[1], overlap.other)
    return best_rotation(a, b, TOLERANCE_RAD, rng)


def _guess(field: ImageField, degrees: float) -> Camera:
    """Return the lens of a field of view whose profile is that of the prior."""
    if field.outer is None:
        raise ValueError("the field has no image circle")
    rim, (cx, cy) = np.radians(degrees / 2), field.outer.centre
    focal = float(field.outer.radius / (rim * (1 + K1_MEAN * rim**2)))
    return Camera(KannalaBrandt(focal, focal, cx, cy, K1_MEAN, 0.0, 0.0, 0.0), field.size)


def _moved(camera: Camera, x: Array) -> Camera:
    model: Any = camera.model
    focal = model.fx * float(np.exp(x[0]))
    moved = dataclasses.replace(
        model, fx=focal, fy=focal, k1=model.k1 + x[1], k2=model.k2 + x[2], cx=model.cx + x[3], cy=model.cy + x[4]
    )
    return Camera(moved, camera.size)


def _bearings(camera: Camera, pixels: Array) -> Array:
    """Return bearings (N, 3), zero outside the domain of the model."""
    bearings, valid = camera.model.unproject_numpy(pixels)
    return np.where(valid[:, None], bearings, 0.0)


def _shifted(shift: Array, step: Array) -> Array:
    """Return a direction moved in its tangent plane."""
    basis = np.linalg.svd(shift[None])[2][1:]
    moved = shift + step @ basis
    return moved / np.linalg.norm(moved)


def _at_rim(keypoints: Keypoints, field: ImageField) -> Keypoints:
    if field.outer is None:
        return keypoints
    return keypoints[np.linalg.norm(keypoints.pixels - field.outer.centre, axis=1) > RIM_SHARE * field.outer.radius]


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
    overlap = match_overlap([(a, b) for a, b in keypoints])
    rotation, inliers = _rotation_of(cameras, overlap, np.random.default_rng(0))
    count, unknown = int(inliers.sum()), np.full((13, 13), np.nan)
    if count < MIN_OVERLAP_MATCHES:
        reason = (
            f"only {count} of {len(overlap)} matches agree with a rotation, at least {MIN_OVERLAP_MATCHES} are needed"
        )
        return HeadCalibration(cameras, rotation, unknown, count, np.nan, (), reason)
    overlap = overlap.select(inliers)
    a, b = _bearings(cameras[0], overlap.first), _bearings(cameras[1], overlap.other)
    sigma = 0.0
    for _ in range(20):  # Weiszfeld's algorithm: the geometric median of rotations
        distance = np.linalg.norm(a @ rotation.T - b, axis=1)
        sigma = max(float(np.median(distance) / np.sqrt(2 * np.log(2))), 1e-4)
        weight = 1 / (1 + (distance / (3 * sigma)) ** 2)
        rotation = so3.nearest((b * weight[:, None]).T @ a)
    information = (len(a) * np.eye(3) - b.T @ b) / sigma**2
    covariance = np.zeros((13, 13))
    covariance[10:, 10:] = np.linalg.inv(information)
    return HeadCalibration(cameras, rotation, covariance, count, float(np.degrees(sigma)))
