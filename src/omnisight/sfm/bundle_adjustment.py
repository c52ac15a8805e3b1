"""Bundle adjustment of frames, sensors and points seen by any cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from omnisight.geometry import rotation as so3
from omnisight.optim.levenberg_marquardt import Solution, minimize
from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_for

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Points per task of a thread.
POINTS_PER_TASK = 2048
MAX_ITERATIONS, TOLERANCE = 100, 1e-6
# Damping at the start: the initial points are far from the optimum along their rays.
INITIAL_DAMPING = 1e-4


@dataclass(frozen=True, eq=False)
class RayObservations:
    """Observed rays of points, sorted by point.

    Attributes
    ----------
    frame, sensor, point
        (M,) indices.
    origins, bearings
        (M, 3) of the rays, in the frames of the sensors.
    axes
        (M, 2, 3) tangents along which bearings have unit variance and no correlation.
    """

    frame: Indices
    sensor: Indices
    point: Indices
    origins: Array
    bearings: Array
    axes: Array

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.point)

    def __getitem__(self, use: NDArray[np.bool_] | Indices) -> "RayObservations":
        """Return the observations of a mask or of indices, which must stay sorted by point."""
        return RayObservations(
            self.frame[use], self.sensor[use], self.point[use], self.origins[use], self.bearings[use], self.axes[use]
        )


@dataclass(frozen=True, eq=False)
class Structure:
    """Poses and points.

    Attributes
    ----------
    rig_from_world
        (F, 3, 4) poses of the frames.
    sensor_from_rig
        (S, 3, 4) poses of the sensors.
    points
        (P, 3) in the world frame.
    """

    rig_from_world: Array
    sensor_from_rig: Array
    points: Array

    def squared_residuals(self, rays: RayObservations) -> Array:
        """Return the squared lengths (M,) of the whitened residuals; inf for points behind their rays."""
        from omnisight.sfm._bundle_kernel import squared_lengths

        squares, indices = np.empty(len(rays)), (rays.frame, rays.sensor, rays.point)
        poses = self.rig_from_world, self.sensor_from_rig
        squared_lengths(*poses, self.points, *indices, rays.origins, rays.bearings, rays.axes, squares)
        return squares


@dataclass(frozen=True, eq=False)
class LinearizedBundle:
    """Weighted residuals and their derivatives; the points are eliminated by the Schur complement.

    Attributes
    ----------
    starts
        (P + 1,) first observation of each point.
    point
        (M,) indices of the points.
    columns
        (M, L) column of each derivative by a camera; -1 if it is fixed.
    count
        Number of columns C.
    residuals, by_camera, by_point
        (M, 2), (M, 2, L) and (M, 2, 3).
    """

    starts: Indices
    point: Indices
    columns: Indices
    count: int
    residuals: Array
    by_camera: Array
    by_point: Array

    @property
    def _jacobian(self) -> tuple[Indices, Array, Array, Array]:
        return self.columns, self.residuals, self.by_camera, self.by_point

    def solve(self, damping: float) -> Array:
        """Return the step (C + 3 P,): cameras, then points; NaN if there is none."""
        from omnisight.sfm._bundle_kernel import solve_points

        moves = np.full((len(self.starts) - 1, 3), np.nan)
        try:
            schur, right, diagonal = self.reduced(damping)
            schur[np.diag_indices(self.count)] += damping * diagonal
            step = -cho_solve(cho_factor(schur, lower=True, overwrite_a=True, check_finite=False), right)
        except LinAlgError:
            return np.full(self.count + moves.size, np.nan)
        parallel_for(
            lambda first, last: solve_points(self.starts, *self._jacobian, damping, first, last, step, moves),
            len(moves),
            POINTS_PER_TASK,
        )
        return np.concatenate([step, moves.ravel()])

    def decrease(self, step: Array) -> float:
        """Return the decrease of the linearized cost along a step."""
        from omnisight.sfm._bundle_kernel import linear_decrease

        jacobian = self.residuals, self.by_camera, self.by_point
        moves = step[self.count :].reshape(-1, 3)
        return float(linear_decrease(self.columns, self.point, *jacobian, step[: self.count], moves))

    def reduced(self, damping: float = 0.0) -> tuple[Array, Array, Array]:
        """Return the Schur complement (C, C; lower triangle only), right side and diagonal."""
        from omnisight.sfm._bundle_kernel import reduce_points

        parts: list[tuple[Array, Array, Array]] = []

        def work(first: int, last: int) -> None:
            part = np.zeros((self.count, self.count)), np.zeros(self.count), np.zeros(self.count)
            reduce_points(self.starts, *self._jacobian, damping, first, last, *part)
            parts.append(part)

        parallel_for(work, len(self.starts) - 1, POINTS_PER_TASK)
        total = parts.pop()
        for part in parts:
            for target, values in zip(total, part, strict=True):
                target += values
        return total

    def covariances(self) -> tuple[Array, Array]:
        """Return the covariances of the cameras (C, C), and of the points (P, 3, 3).

        Raises
        ------
        LinAlgError
            If the observations do not determine the cameras.
        """
        from omnisight.sfm._bundle_kernel import point_covariances

        schur, _, _ = self.reduced()
        factor = cho_factor(schur, lower=True, overwrite_a=True, check_finite=False)
        cameras = np.asarray(cho_solve(factor, np.eye(self.count)), float)
        points = np.empty((len(self.starts) - 1, 3, 3))
        parallel_for(
            lambda first, last: point_covariances(self.starts, *self._jacobian, cameras, first, last, points),
            len(points),
            POINTS_PER_TASK,
        )
        return cameras, points


@dataclass(frozen=True)
class Bundle:
    """The least-squares problem over `Structure`.

    The observations determine neither place nor scale of the world: the first frame and the first sensor are fixed, and
    for the scale the largest coordinate of the frame that is farthest from the first, or, if the sensors have a scale
    and are refined, of the farthest sensor.

    Attributes
    ----------
    rays
        The observations.
    loss
        Robust loss of the whitened residuals.
    start
        The structure that fixes the gauge.
    has_scale
        Whether the poses of the sensors determine the scale.
    refines_sensors
        Whether the poses of all sensors but the first are refined.
    """

    rays: RayObservations
    loss: StudentT
    start: Structure
    has_scale: bool = False
    refines_sensors: bool = False

    @cached_property
    def starts(self) -> Indices:
        """First observation (P + 1,) of each point."""
        return np.searchsorted(self.rays.point, np.arange(len(self.start.points) + 1))

    @cached_property
    def parameters(self) -> tuple[Indices, Indices, int]:
        """Columns of the frames (F, 6) and of the sensors (S, 6), -1 if they are fixed, and their number."""
        frames, sensors = self.start.rig_from_world, self.start.sensor_from_rig
        is_free, is_seen = np.ones((len(frames) + len(sensors), 6), bool), np.zeros(len(frames) + len(sensors), bool)
        is_seen[self.rays.frame], is_seen[len(frames) + self.rays.sensor] = True, True
        is_free[~is_seen] = False
        is_free[0] = False
        is_free[len(frames) :] &= self.refines_sensors
        is_free[len(frames)] = False
        if self.has_scale and self.refines_sensors:
            is_free[len(frames) :][_farthest_coordinate(sensors)] = False
        elif not self.has_scale and len(frames) > 1:
            is_free[_farthest_coordinate(frames)] = False
        columns = np.where(is_free, np.cumsum(is_free).reshape(is_free.shape) - 1, -1)
        return columns[: len(frames)], columns[len(frames) :], int(is_free.sum())

    @cached_property
    def columns(self) -> Indices:
        """Columns (M, 6 or 12) of the derivatives of each observation."""
        frames, sensors, _ = self.parameters
        of_frames = frames[self.rays.frame]
        return np.hstack([of_frames, sensors[self.rays.sensor]]) if self.refines_sensors else of_frames

    def cost(self, state: Structure) -> float:
        """Return the robust cost."""
        return self.loss.cost(state.squared_residuals(self.rays))

    def linearize(self, state: Structure, weights: Array | None = None) -> LinearizedBundle:
        """Return residuals and derivatives with weights (M,), by default those of the loss."""
        from omnisight.sfm._bundle_kernel import linearize

        rays, count = self.rays, len(self.rays)
        weights = self.loss.weight(state.squared_residuals(rays)) if weights is None else weights
        residuals, by_point = np.empty((count, 2)), np.empty((count, 2, 3))
        by_camera = np.empty((count, 2, self.columns.shape[1]))
        indices, derivatives = (rays.frame, rays.sensor, rays.point), (residuals, by_camera, by_point)
        poses = state.rig_from_world, state.sensor_from_rig
        linearize(*poses, state.points, *indices, rays.origins, rays.axes, weights, *derivatives)
        return LinearizedBundle(self.starts, rays.point, self.columns, self.parameters[2], *derivatives)

    def covariances(self, state: Structure) -> tuple[Array, Array]:
        """Return the covariances of the cameras (C, C), and of the points (P, 3, 3), at the optimum.

        They are those of maximum likelihood, with the expected information of the residuals.

        Raises
        ------
        LinAlgError
            If the observations do not determine the cameras.
        """
        weights = np.where(np.isfinite(state.squared_residuals(self.rays)), self.loss.information, 0.0)
        return self.linearize(state, weights).covariances()

    def move(self, state: Structure, step: Array) -> Structure:
        """Return the structure moved by a step."""
        frames, sensors, count = self.parameters
        # The last entry is that of fixed parameters, whose column is -1.
        cameras, moves = np.append(step[:count], 0.0), step[count:].reshape(-1, 3)
        return Structure(
            _moved(state.rig_from_world, cameras[frames]),
            _moved(state.sensor_from_rig, cameras[sensors]),
            state.points + moves,
        )


def adjust_bundle(
    bundle: Bundle, *, tolerance: float = TOLERANCE, watch: Callable[[int, float], None] | None = None
) -> Solution[Structure]:
    """Minimize the robust cost by Levenberg-Marquardt.

    B. Triggs et al., Bundle adjustment: a modern synthesis, 2000.
    """
    return minimize(
        bundle, bundle.start, iterations=MAX_ITERATIONS, tolerance=tolerance, damping=INITIAL_DAMPING, watch=watch
    )


def _farthest_coordinate(poses: Array) -> tuple[int, int]:
    """Return the pose (N, 3, 4) farthest from the first, and the element of its step that changes the distance most."""
    centers = -np.einsum("fji,fj->fi", poses[:, :, :3], poses[:, :, 3])
    farthest = int(np.linalg.norm(centers - centers[0], axis=1).argmax())
    # In the frame of the camera, the distance from the first changes most along this coordinate.
    baseline = poses[farthest, :, :3] @ (centers[0] - centers[farthest])
    return farthest, 3 + int(np.abs(baseline).argmax())


def _moved(poses: Array, steps: Array) -> Array:
    """Return poses (N, 3, 4) moved by steps (N, 6); see `Pose.moved`."""
    moved = poses.copy()
    moved[:, :, :3] = so3.exp(steps[:, :3]) @ poses[:, :, :3]
    moved[:, :, 3] += steps[:, 3:]
    return moved
