"""Error of the best central approximation of a non-central camera, near and far."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import polar
from omnisight.models import CameraModel
from omnisight.optics.models.axial import Axial
from omnisight.optim.gauss_newton import gauss_newton

Array = NDArray[np.float64]

# Grid of directions in which the error is evaluated.
RINGS, SECTORS = 31, 24
# Distances at which the error is evaluated: metres, or board widths if the size of the board is unknown.
DISTANCES_M, DISTANCES_BOARD_WIDTHS = (0.2, 1.0, 5.0), (1.0, 5.0, 25.0)


@dataclass(frozen=True)
class CentralApproximationError(Displayed):
    """The error of a central camera at several distances, against an axial camera fitted to the same boards.

    The central camera is placed where it agrees best with the axial one on the board corners, as a pose estimated with
    it would be.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    distances
        (D,) along the rays, in the unit of the boards.
    pixels, angles
        (D, A) root mean square over the azimuth of the pixel error (px) and of the bearing error (radians); NaN outside
        the image.
    max_pixels, rms_pixels, max_angles, rms_angles
        (D,) maximum and root mean square over the field of view, weighted by solid angle.
    """

    theta: Array
    distances: Array
    pixels: Array
    angles: Array
    max_pixels: Array
    rms_pixels: Array
    max_angles: Array
    rms_angles: Array

    @classmethod
    def of(
        cls,
        central: CameraModel,
        axial: Axial,
        points: Array,
        *,
        size: tuple[int, int],
        cone: tuple[float, float],
        distances: tuple[float, ...],
    ) -> Self:
        """Compare a central and an axial camera.

        Parameters
        ----------
        central, axial
            The cameras.
        points
            (N, 3) board corners in the frame of the axial camera.
        size
            (width, height) of the image, px.
        cone
            Least and greatest angle from the axis (radians) of the corners.
        distances
            Distances in the unit of the points.
        """
        central_from_axial = align_central(central, axial, points)
        theta = np.linspace(max(cone[0], 1e-3), min(cone[1], axial.theta_max), RINGS)
        grid = np.meshgrid(theta, 2 * np.pi * np.arange(SECTORS) / SECTORS, indexing="ij")
        bearings = polar(*(angle.ravel() for angle in grid))
        observed, visible = axial.lens.project_numpy(bearings)
        visible &= np.all((observed >= -0.5) & (observed < np.array(size) - 0.5), axis=-1)
        origins = axial.pupil_z(grid[0].ravel())[:, None] * (0.0, 0.0, 1.0)
        central_bearings, has_bearing = central.unproject_numpy(observed)
        pixel_errors, bearing_errors = list[Array](), list[Array]()
        for distance in distances:
            scene = central_from_axial @ (origins + distance * bearings)
            pixels, valid = central.project_numpy(scene)
            use = visible & has_bearing & valid
            pixel_errors.append(np.where(use, np.linalg.norm(pixels - observed, axis=1), np.nan))
            across = np.linalg.norm(np.cross(central_bearings, scene), axis=1)
            bearing_errors.append(np.where(use, np.arctan2(across, (central_bearings * scene).sum(-1)), np.nan))
        shape = len(distances), RINGS, SECTORS
        px, rad = np.reshape(pixel_errors, shape), np.reshape(bearing_errors, shape)
        solid_angle, equal = np.sin(theta)[:, None], np.ones((RINGS, 1))
        return cls(
            theta,
            np.array(distances, float),
            _rms(px, equal, (2,)),
            _rms(rad, equal, (2,)),
            _max(px),
            _rms(px, solid_angle, (1, 2)),
            _max(rad),
            _rms(rad, solid_angle, (1, 2)),
        )


def align_central(central: CameraModel, axial: Axial, points: Array) -> Pose:
    """Estimate central_from_axial: the pose at which a central camera sees points (N, 3) as the axial one does."""
    observed, valid = axial.project_numpy(points)
    points, observed = points[valid], observed[valid]

    def linearize(pose: Pose) -> tuple[Array, Array]:
        rotated = points @ pose.rotation.T
        pixels, _, d_point, _ = central.project_with_jacobians(rotated + pose.translation)
        use = np.asarray(np.isfinite(pixels).all(1) & np.isfinite(d_point).all((1, 2)))
        jacobian = np.concatenate([-d_point @ so3.hat(rotated), d_point], -1)
        residuals = np.where(use[:, None], pixels - observed, 0.0)
        return residuals.ravel(), np.where(use[:, None, None], jacobian, 0.0).reshape(-1, 6)

    return gauss_newton(linearize, Pose(), retract=lambda pose, step: pose.moved(step)).state


def _rms(values: Array, weight: Array, axes: tuple[int, ...]) -> Array:
    known = np.asarray(np.isfinite(values))
    total = np.where(known, weight, 0.0).sum(axes)
    squares = np.where(known, weight * values**2, 0.0).sum(axes)
    return np.where(total > 0, np.sqrt(squares / np.where(total > 0, total, 1.0)), np.nan)


def _max(values: Array) -> Array:
    largest = np.where(np.isfinite(values), values, -np.inf).max((1, 2))
    return np.where(np.isfinite(largest), largest, np.nan)
