"""What a central camera leaves of one whose rays meet in no point, near and far."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.state import State
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import polar
from omnisight.models import CameraModel
from omnisight.optics.models.axial import Axial
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

RINGS, SECTORS = 31, 24
# Distances that are asked about: metres, or widths of a board whose size is not known.
METRES, WIDTHS = (0.2, 1.0, 5.0), (1.0, 5.0, 25.0)
STEPS, SETTLED = 10, 1e-10


@dataclass(frozen=True)
class CentralApproximationError:
    """The error of a central camera for what lies at certain distances, against an axial one fitted to the same boards.

    The central camera stands where it agrees best with the axial one about the corners of the boards: so a pose found
    with it stands, for points at every distance.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    distances
        (D,) along the rays, in the unit of the boards.
    pixels, angles
        (D, A) root mean square over the azimuth of the error of a pixel (px) and of a bearing (radians); NaN where the
        image shows nothing.
    worst_pixels, rms_pixels, worst_angles, rms_angles
        (D,) the largest and the root mean square over the field, each direction by its solid angle.
    """

    theta: Array
    distances: Array
    pixels: Array
    angles: Array
    worst_pixels: Array
    rms_pixels: Array
    worst_angles: Array
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
        """Compare the two.

        Parameters
        ----------
        central, axial
            The cameras.
        points
            (N, 3) corners of the boards in the frame of the axial one.
        size
            (width, height) of the image, px.
        cone
            The angles from the axis (radians) between which corners were seen.
        distances
            In the unit of the points.
        """
        central_from_axial = aligned(central, axial, points)
        theta = np.linspace(max(cone[0], 1e-3), min(cone[1], axial.theta_max), RINGS)
        grid = np.meshgrid(theta, 2 * np.pi * np.arange(SECTORS) / SECTORS, indexing="ij")
        bearings = polar(*(angle.ravel() for angle in grid))
        seen, shown = axial.lens.project_numpy(bearings)
        shown &= np.all((seen >= -0.5) & (seen < np.array(size) - 0.5), axis=-1)
        start = axial.pupil_z(grid[0].ravel())[:, None] * (0.0, 0.0, 1.0)
        taken, back = central.unproject_numpy(seen)
        off, turned = list[Array](), list[Array]()
        for distance in distances:
            there = central_from_axial @ (start + distance * bearings)
            pixels, valid = central.project_numpy(there)
            use = shown & back & valid
            off.append(np.where(use, np.linalg.norm(pixels - seen, axis=1), np.nan))
            across = np.linalg.norm(np.cross(taken, there), axis=1)
            turned.append(np.where(use, np.arctan2(across, (taken * there).sum(-1)), np.nan))
        shape = len(distances), RINGS, SECTORS
        off_px, off_rad = np.reshape(off, shape), np.reshape(turned, shape)
        weight = np.sin(theta)[:, None]
        return cls(
            theta,
            np.array(distances, float),
            _rms(off_px, np.ones_like(weight), (2,)),
            _rms(off_rad, np.ones_like(weight), (2,)),
            _most(off_px),
            _rms(off_px, weight, (1, 2)),
            _most(off_rad),
            _rms(off_rad, weight, (1, 2)),
        )


def aligned(central: CameraModel, axial: Axial, points: Array) -> Pose:
    """Give central_from_axial for which a central camera sees points (N, 3) most nearly where the axial one does."""
    seen, valid = axial.project_numpy(points)
    points, seen = points[valid], seen[valid]
    pose = Pose()
    for _ in range(STEPS):
        turned = points @ pose.rotation.T
        pixels, _, d_point, _ = central.project_with_jacobians(turned + pose.translation)
        use = np.isfinite(pixels).all(1) & np.isfinite(d_point).all((1, 2))
        effect = np.concatenate([-d_point @ so3.hat(turned), d_point], -1)[use].reshape(-1, 6)
        step = -np.linalg.lstsq(effect, (pixels - seen)[use].ravel(), rcond=None)[0]
        pose = pose.moved(step)
        if np.abs(effect @ step).max(initial=0.0) < SETTLED:
            break
    return pose


def corners(state: State, views: Observations, usable: NDArray[np.bool_]) -> Array:
    """Give the corners (N, 3) that count, in the camera's frame."""
    return state.points(views)[0][usable]


def _rms(values: Array, weight: Array, axes: tuple[int, ...]) -> Array:
    known = np.isfinite(values)
    total = np.where(known, weight, 0.0).sum(axes)
    squares = np.where(known, weight * values**2, 0.0).sum(axes)
    return np.where(total > 0, np.sqrt(squares / np.where(total > 0, total, 1.0)), np.nan)


def _most(values: Array) -> Array:
    most = np.where(np.isfinite(values), values, -np.inf).max((1, 2))
    return np.where(np.isfinite(most), most, np.nan)
