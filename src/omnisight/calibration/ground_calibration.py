"""Poses of cameras above the ground, from markings at known places on it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from omnisight.display import Displayed, named_tuple_text
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import hat
from omnisight.optim.loss import robust_sigma
from omnisight.rig import Rig
from omnisight.twoview.absolute_pose import resect

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Unknowns of a pose, and the marks that determine them with one to spare.
POSE_PARAMETERS = 6
MIN_MARKS = 4
# Marks beyond so many standard deviations are outliers: 1 in 10^4 of two normal coordinates.
OUTLIER_SIGMA = 4.3
# Marks that are closer are the same mark, seen by two cameras.
MIN_LENGTH_M = 1e-6
# Rounds in which the scale of the residuals and the pose are estimated in turn.
SCALE_ROUNDS = 3
# Residuals of exact marks are rounding errors, which have no scale.
MIN_SIGMA_PX = 1e-6


@dataclass(frozen=True, eq=False)
class GroundMarks(Displayed):
    """Markings on the ground that one camera sees.

    Attributes
    ----------
    pixels
        (N, 2) pixels.
    ground
        (N, 2) positions right and forward on the ground, metres.
    """

    pixels: Array
    ground: Array

    def __post_init__(self) -> None:
        """Check the shapes."""
        if self.pixels.shape != self.ground.shape or self.pixels.shape[1:] != (2,):
            raise ValueError(f"marks need (N, 2) pixels and positions, got {self.pixels.shape}, {self.ground.shape}")

    def __len__(self) -> int:
        """Return the number of marks."""
        return len(self.pixels)


class CameraFit(NamedTuple):
    """How the marks fit one camera.

    Attributes
    ----------
    rms_px
        Root mean square of the residuals of the inliers; NaN without marks.
    inliers
        (N,) marks that are no outliers.
    height
        Height of the camera above the ground, metres.
    sigma_height
        Its standard deviation.
    """

    rms_px: float
    inliers: Mask
    height: float
    sigma_height: float

    __repr__ = named_tuple_text


@dataclass(frozen=True, eq=False)
class GroundCalibration(Displayed):
    """A rig in the ground frame; false if it was not determined.

    Attributes
    ----------
    rig
        The rig with its covariance. Its frame is on the ground (y = 0): x right, y down, z forward; metres.
    marks
        The marks by camera name.
    fits
        How they fit, by camera name.
    reason
        Why there is no rig; empty otherwise.
    """

    rig: Rig
    marks: Mapping[str, GroundMarks] = field(repr=False)
    fits: Mapping[str, CameraFit]
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether the poses were determined."""
        return not self.reason


def on_ground(ground: ArrayLike) -> Array:
    """Return the points (..., 3) of the ground frame at positions (..., 2) right and forward."""
    g = np.asarray(ground, float)
    return np.stack([g[..., 0], np.zeros(g.shape[:-1]), g[..., 1]], -1)


def calibrate_ground(rig: Rig, marks: Mapping[str, GroundMarks]) -> GroundCalibration:
    """Estimate the poses of the cameras of a rig from marks on the ground.

    Each pose is found by RANSAC from bearings, and refined by least squares of the residuals in px with a Cauchy loss,
    whose scale is that of the residuals. The poses of the rig are not used. The intrinsics stay as they are.

    Parameters
    ----------
    rig
        The rig; each camera needs marks.
    marks
        The marks of each camera, by its name.
    """
    poses, fits, blocks = list[Pose](), dict[str, CameraFit](), list[Array]()
    for k, name in enumerate(rig.names):
        seen = marks.get(name)
        if seen is None or len(seen) < MIN_MARKS:
            count = 0 if seen is None else len(seen)
            return GroundCalibration(
                rig,
                marks,
                fits,
                f"{name}: marks on the ground: {count} found, {MIN_MARKS} needed; check the order of the images, and"
                " the positions and the size of squares in the file of the ground",
            )
        start = _initial_pose(rig, k, seen)
        if start is None:
            return GroundCalibration(
                rig, marks, fits, f"{name}: its {len(seen)} marks determine no pose; check their pixels and positions"
            )
        pose, covariance, fit = _refine(rig, k, start, seen)
        if not fit.height > 0:
            return GroundCalibration(
                rig, marks, fits, f"{name} would be below the ground: the positions of its marks are mirrored"
            )
        poses.append(pose)
        blocks.append(covariance)
        fits[name] = fit
    covariance = np.zeros((6 * len(rig), 6 * len(rig)))
    for k, block in enumerate(blocks):
        covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
    calibrated = replace(rig.in_frame(poses, covariance), unit="m")
    return GroundCalibration(calibrated, marks, fits)


def length_errors(rig: Rig, marks: Mapping[str, GroundMarks], *, across: bool = False) -> Array:
    """Return the errors (N,), metres, of the distances between marks, measured on the ground.

    Each mark is put where the ray of its pixel meets the ground. All pairs of marks at different places count, also
    those of two cameras.

    Parameters
    ----------
    rig
        The rig in the ground frame.
    marks
        The marks by camera name.
    across
        Count only pairs of marks of different cameras.
    """
    places, measured, cameras = list[Array](), list[Array](), list[Array]()
    for k, (name, seen) in enumerate(marks.items()):
        at, valid = ground_position(rig, name, seen.pixels)
        places.append(seen.ground[valid])
        measured.append(at[valid])
        cameras.append(np.full(int(valid.sum()), float(k)))
    true, found, camera = np.concatenate(places), np.concatenate(measured), np.concatenate(cameras)
    a, b = np.triu_indices(len(true), 1)
    length = np.linalg.norm(true[a] - true[b], axis=1)
    used = length > MIN_LENGTH_M
    if across:
        used &= camera[a] != camera[b]
    return np.linalg.norm(found[a[used]] - found[b[used]], axis=1) - length[used]


def ground_position(rig: Rig, sensor: int | str, pixels: ArrayLike) -> tuple[Array, Mask]:
    """Return where the rays of pixels (..., 2) of a camera meet the ground (..., 2), and whether they do (...)."""
    rays = rig.rays(sensor, pixels)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -rays.origins[..., 1] / rays.bearings[..., 1]
        meets = rays.valid & (distance > 0) & np.isfinite(distance)
    point = rays.origins + np.where(meets, distance, np.nan)[..., None] * rays.bearings
    return point[..., [0, 2]], meets


def _initial_pose(rig: Rig, sensor: int, seen: GroundMarks) -> Pose | None:
    rays = rig.cameras[sensor].rays(seen.pixels)
    use = rays.valid
    if use.sum() < MIN_MARKS:
        return None
    return resect(on_ground(seen.ground[use]), rays.bearings[use]).cam_from_world


def _refine(rig: Rig, sensor: int, start: Pose, seen: GroundMarks) -> tuple[Pose, Array, CameraFit]:
    """Return the refined pose, the covariance of a step of it, and how the marks fit."""
    camera, points = rig.cameras[sensor], on_ground(seen.ground)

    def residuals(step: Array) -> Array:
        pixels, valid = camera.project(start.moved(step) @ points)
        # A point outside the domain of the model is as wrong as the image is wide.
        return np.where(valid[:, None], pixels - seen.pixels, float(max(camera.size))).ravel()

    step = np.zeros(POSE_PARAMETERS)
    length = np.linalg.norm(residuals(step).reshape(-1, 2), axis=1)
    scale = max(robust_sigma(length), MIN_SIGMA_PX)
    for _ in range(SCALE_ROUNDS):
        step = least_squares(residuals, step, loss="cauchy", f_scale=scale, x_scale="jac").x
        length = np.linalg.norm(residuals(step).reshape(-1, 2), axis=1)
        scale = max(robust_sigma(length), MIN_SIGMA_PX)
    inliers = length <= OUTLIER_SIGMA * scale * np.sqrt(len(seen) / max(len(seen) - POSE_PARAMETERS / 2, 1))
    used = np.repeat(inliers, 2)
    final = least_squares(lambda s: residuals(s)[used], step, x_scale="jac")
    square = float(final.fun @ final.fun)
    variance = square / max(int(used.sum()) - POSE_PARAMETERS, 1)
    covariance = variance * np.linalg.pinv(final.jac.T @ final.jac)
    pose = start.moved(final.x)
    # The covariance is that of a step from the start; the rotation of the refinement is small.
    position = _position_covariance(pose, covariance)
    rms = float(np.sqrt(square / max(int(inliers.sum()), 1)))
    height = -pose.inverse().translation[1]
    return pose, covariance, CameraFit(rms, inliers, float(height), float(np.sqrt(position[1, 1])))


def _position_covariance(pose: Pose, covariance: Array) -> Array:
    """Return the covariance (3, 3) of the camera centre c = -R^T t for steps of R <- exp(w) R, t <- t + v."""
    jacobian = np.hstack([-pose.rotation.T @ hat(pose.translation), -pose.rotation.T])
    return jacobian @ covariance @ jacobian.T
