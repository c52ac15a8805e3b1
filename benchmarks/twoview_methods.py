"""The methods that the benchmark of two views compares, and their errors."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import poselib
import pycolmap
from numpy.typing import NDArray

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.twoview.relative_pose import tangent_basis

Array = NDArray[np.float64]

# All methods accept residuals of up to three standard deviations.
THRESHOLD = 3.0
# Focal length of the virtual camera with which PoseLib sees bearings, and its largest field of view, degrees.
FOCAL, WIDEST = 1000.0, 120.0
PINHOLE = {"model": "PINHOLE", "width": 4000, "height": 4000, "params": [FOCAL, FOCAL, 2000.0, 2000.0]}
SUCCESS_DEG = (0.5, 2.0)


@dataclass(frozen=True)
class Estimate:
    """A pose, None if nothing was found, and the covariance of its step if the method states it."""

    pose: om.Pose | None
    covariance: Array | None = None


def ours(a: Array, b: Array, sigma_deg: float | None) -> Estimate:
    found = om.relative_pose(a, b, sigma_deg=sigma_deg)
    return Estimate(found.b_from_a, found.covariance)


def colmap(a: Array, b: Array, sigma_deg: float) -> Estimate:
    options = pycolmap.RANSACOptions(max_error=THRESHOLD * np.radians(sigma_deg), random_seed=0)
    found = pycolmap.estimate_relative_pose(a, b, options)
    return Estimate(None if found is None else as_pose(found["cam2_from_cam1"].matrix()))


def poselib_relative(a: Array, b: Array, sigma_deg: float) -> Estimate:
    limit = pixel_threshold(a, sigma_deg)
    pixels = pixels_of(a), pixels_of(b)
    found, _ = poselib.estimate_relative_pose(*pixels, PINHOLE, PINHOLE, {"max_epipolar_error": limit, "seed": 0})
    return Estimate(as_pose(found.Rt))


def ours_absolute(points: Array, bearings: Array, sigma_deg: float) -> Estimate:
    found = om.resect(points, bearings, sigma_deg=sigma_deg)
    return Estimate(found.cam_from_world, found.covariance)


def poselib_absolute(points: Array, bearings: Array, sigma_deg: float) -> Estimate:
    options = {"max_reproj_error": pixel_threshold(bearings, sigma_deg), "seed": 0}
    found, _ = poselib.estimate_absolute_pose(pixels_of(bearings), points, PINHOLE, options)
    return Estimate(as_pose(found.Rt))


def as_pose(matrix: Array) -> om.Pose:
    return om.Pose(matrix[:, :3], matrix[:, 3])


def pixels_of(bearings: Array) -> Array:
    return 2000.0 + FOCAL * bearings[:, :2] / bearings[:, 2:]


def pixel_threshold(bearings: Array, sigma_deg: float) -> float:
    """Return the threshold in pixels, where the noise of pixels is the root mean square over the field of view."""
    # A pinhole camera stretches radially by 1/cos^2, and tangentially by 1/cos.
    cosine = bearings[:, 2]
    return float(THRESHOLD * FOCAL * np.radians(sigma_deg) * np.sqrt(((cosine**-4 + cosine**-2) / 2).mean()))


@dataclass
class Tally:
    """Errors and times of one method in one cell."""

    errors: list[tuple[float, float]] = field(default_factory=list)
    squares: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)

    def add(self, estimate: Callable[[], Estimate], truth: om.Pose, freedom: int) -> None:
        """Run a method and compare its pose with the truth: up to scale with 5 degrees of freedom."""
        wall, cpu = time.perf_counter(), time.process_time()
        found = estimate()
        self.cpu.append(1000 * (time.process_time() - cpu))
        self.wall.append(1000 * (time.perf_counter() - wall))
        if found.pose is None:
            self.errors.append((np.inf, np.inf))
            return
        turn = so3.log(truth.rotation @ found.pose.rotation.T)
        if freedom == 6:
            shift = truth.translation - found.pose.translation
            error = float(np.linalg.norm(shift))
        else:
            shift = arc(found.pose.translation / np.linalg.norm(found.pose.translation), truth.translation)
            error = float(np.degrees(np.linalg.norm(shift)))
        self.errors.append((float(np.degrees(np.linalg.norm(turn))), error))
        if found.covariance is not None:
            basis = np.eye(6) if freedom == 6 else tangent_basis(found.pose)
            step = basis.T @ np.concatenate([turn, shift])
            self.squares.append(float(step @ np.linalg.solve(basis.T @ found.covariance @ basis, step)) / freedom)

    @property
    def success(self) -> float:
        """Share of poses with a rotation error below 0.5 and a direction error below 2 degrees."""
        return float((np.array(self.errors) < SUCCESS_DEG).all(axis=1).mean())

    @property
    def medians(self) -> tuple[float, float]:
        """Median errors."""
        rotation, translation = np.median(self.errors, axis=0)
        return float(rotation), float(translation)


def arc(start: Array, end: Array) -> Array:
    """Return the tangent vector at a direction that leads to another one along a great circle."""
    across = end - (start @ end) * start
    length = np.linalg.norm(across)
    return across * (np.arctan2(length, start @ end) / max(length, 1e-300))
