"""Bundle adjustment of frames, sensors and points seen by any cameras."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, vstack

from omnisight.geometry import rotation as so3
from omnisight.optim.block_matrix import BlockMatrix, BlockPattern
from omnisight.optim.levenberg_marquardt import Solution, minimize
from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_for
from omnisight.sfm.common_points import divided_points, strongly_connected_frames
from omnisight.sfm.linearized_bundle import POINTS_PER_TASK, CameraColumns, DividedPoints, LinearizedBundle, Prior
from omnisight.sfm.measurements import Measurements
from omnisight.sfm.pixel_rays import PixelRays
from omnisight.sfm.structure import RAYS_PER_TASK, RayObservations, Structure

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Steps, and expected relative decrease of the cost at which they end.
MAX_ITERATIONS, TOLERANCE = 100, 1e-6
# Damping at the start: the initial points are far from the optimum along their rays.
INITIAL_DAMPING = 1e-4
# Derivatives by a pose.
POSE = 6
# Columns of the cameras up to which their matrix is one block: it is factored in a few milliseconds, and needs no order
# of elimination.
MAX_DENSE_COLUMNS = 600
# Columns of the cameras up to which their matrix is factored. Beyond, the preconditioner of conjugate gradients
# connects only frames with this share of common points. Of 3000 frames of a town, in which clouds connect streets, it
# keeps 96 % of the observations, and takes 0.3 % of the arithmetic of the factorization of the whole matrix, and 18 to
# 50 iterations. With the 60 frames of most common points instead, a step took seven times as long.
MAX_FACTORED_COLUMNS, STRONG_SHARE = 6000, 0.01


@dataclass(frozen=True)
class Bundle:
    """The least-squares problem over `Structure`.

    The observations determine neither place nor scale of the world. Without measurements the first frame and the first
    sensor are fixed, and for the scale the largest coordinate of the frame that is farthest from the first, or, if the
    sensors have a scale and are refined, of the farthest sensor.

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
    pixels
        The pixels of the observations, if their cameras are refined.
    measured
        What was measured of the cameras besides, in the unit of the world.
    """

    rays: RayObservations
    loss: StudentT
    start: Structure
    has_scale: bool = False
    refines_sensors: bool = False
    pixels: PixelRays | None = None
    measured: Measurements | None = None

    @cached_property
    def starts(self) -> Indices:
        """First observation (P + 1,) of each point."""
        return np.searchsorted(self.rays.point, np.arange(len(self.start.points) + 1))

    @cached_property
    def parameters(self) -> tuple[Indices, Indices, int]:
        """Columns of the frames (F, 6) and of the sensors (S, 6), -1 if they are fixed, and the number of columns.

        Those of the values of free cameras are the last.
        """
        frames, sensors = self.start.rig_from_world, self.start.sensor_from_rig
        is_free, is_seen = np.ones((len(frames) + len(sensors), 6), bool), np.zeros(len(frames) + len(sensors), bool)
        is_seen[self.rays.frame], is_seen[len(frames) + self.rays.sensor] = True, True
        is_free[~is_seen] = False
        is_free[0] &= self.measured is not None and self.measured.fixes_gauge
        is_free[len(frames) :] &= self.refines_sensors
        is_free[len(frames)] = False
        if self.has_scale and self.refines_sensors:
            is_free[len(frames) :][_farthest_coordinate(sensors)] = False
        elif not self.has_scale and self.measured is None and len(frames) > 1:
            is_free[_farthest_coordinate(frames)] = False
        columns = np.where(is_free, np.cumsum(is_free).reshape(is_free.shape) - 1, -1)
        return columns[: len(frames)], columns[len(frames) :], int(is_free.sum()) + len(self.start.values)

    @cached_property
    def cameras(self) -> CameraColumns:
        """Where the derivatives of observations by frames, sensors and free values are in the normal equations."""
        frames, sensors, count = self.parameters
        sizes = np.concatenate([(frames >= 0).sum(axis=1), (sensors >= 0).sum(axis=1), [len(self.start.values)]])
        group = np.where(sizes > 0, np.cumsum(sizes > 0) - 1, -1)
        if count <= MAX_DENSE_COLUMNS:
            group = np.minimum(group, 0)
        parts = [(frames[self.rays.frame], group[: len(frames)][self.rays.frame])]
        if self.refines_sensors:
            parts.append((sensors[self.rays.sensor], group[len(frames) : -1][self.rays.sensor]))
        if values := len(self.start.values):
            shape = len(self.rays), values
            parts.append((np.broadcast_to(np.arange(count - values, count), shape), np.full(shape[0], group[-1])))
        columns, groups = zip(*parts, strict=True)
        firsts = np.cumsum([0, *(of_part.shape[1] for of_part in columns)])
        of_rays = np.column_stack(groups)
        starts = np.concatenate([[0], np.cumsum(sizes[sizes > 0])])
        is_dense = count <= MAX_DENSE_COLUMNS
        pattern = BlockPattern.dense(count) if is_dense else self._pattern(starts, of_rays, self.rays.point)
        return CameraColumns(
            np.concatenate(columns, axis=1).astype(np.int32), of_rays.astype(np.int32), firsts, pattern
        )

    @cached_property
    def divided(self) -> DividedPoints | None:
        """The points of the preconditioner; None if the matrix of the cameras is factored."""
        if self.parameters[2] <= MAX_FACTORED_COLUMNS:
            return None
        frame, cameras = self.rays.frame, self.cameras
        distance = self.start.distances(self.rays)
        is_strong = strongly_connected_frames(frame, self.rays.point, distance, STRONG_SHARE)
        part = divided_points(frame, self.rays.point, is_strong)
        order = np.argsort(part, kind="stable")
        use = order[np.bincount(part)[part[order]] > 1]
        point = np.unique(part[use], return_inverse=True)[1]
        starts, groups = np.searchsorted(point, np.arange(int(point.max(initial=-1)) + 2)), cameras.groups[use]
        pattern = self._pattern(cameras.pattern.starts, groups, point)
        return DividedPoints(use, starts, point, CameraColumns(cameras.columns[use], groups, cameras.parts, pattern))

    def _pattern(self, starts: Indices, groups: NDArray[np.integer], point: Indices) -> BlockPattern:
        """Return the pattern of groups with these first columns; observations have groups (M, K) and points (M,)."""
        residuals, derivatives = self._prior(self.start)
        prior, points = coo_array(derivatives), int(point.max(initial=-1)) + 1
        of_rays, is_free = np.broadcast_to(point[:, None], groups.shape), groups >= 0
        of_prior = np.searchsorted(starts, prior.col, side="right") - 1
        ends = np.append(of_rays[is_free], points + prior.row), np.append(groups[is_free], of_prior)
        shape = points + len(residuals), len(starts) - 1
        return BlockPattern.of_incidence(starts, csr_array(coo_array((np.ones(len(ends[0]), bool), ends), shape)))

    def rays_at(self, state: Structure) -> RayObservations:
        """Return the rays with the cameras of a state."""
        if self.pixels is None:
            return self.rays
        bearings, axes = self.pixels.at(state.values)
        return replace(self.rays, bearings=bearings, axes=axes)

    def squared_residuals(self, state: Structure) -> Array:
        """Return the squared lengths (M,) of the whitened residuals; inf for points behind their rays."""
        return state.squared_residuals(self.rays_at(state))

    def cost(self, state: Structure) -> float:
        """Return the robust cost."""
        measured = () if self.measured is None else self.measured.linearize(state.rig_from_world).residuals
        residuals = np.append(self._precision * state.values, measured)
        return self.loss.cost(self.squared_residuals(state)) + 0.5 * float(residuals @ residuals)

    def linearize(self, state: Structure, weights: Array | None = None) -> LinearizedBundle:
        """Return residuals and derivatives with weights (M,), by default those of the loss."""
        from omnisight.sfm._bundle_kernel import linearize

        rays = self.rays_at(state)
        count, poses = len(rays), (state.rig_from_world, state.sensor_from_rig)
        weights = self.loss.weight(state.squared_residuals(rays)) if weights is None else weights
        residuals, by_point = np.empty((count, 2)), np.empty((count, 2, 3))
        by_pose = np.empty((count, 2, self.cameras.columns.shape[1] - len(state.values)))
        indices, derivatives = (rays.frame, rays.sensor, rays.point), (residuals, by_pose, by_point)
        parallel_for(
            lambda first, last: linearize(
                *poses, state.points, *indices, rays.origins, rays.axes, weights, first, last, *derivatives
            ),
            count,
            RAYS_PER_TASK,
        )
        if self.pixels is not None:
            by_values = self.pixels.derivatives(state.values, state.directions(rays))
            by_pose = np.concatenate([by_pose, np.sqrt(weights)[:, None, None] * by_values], axis=2)
        return LinearizedBundle(
            self.starts, rays.point, self.cameras, residuals, by_pose, by_point, self._prior(state), self.divided
        )

    @property
    def _precision(self) -> Array:
        """The inverse standard deviations (Q,) of the priors of free values."""
        return np.zeros(0) if self.pixels is None else np.sqrt(self.pixels.free.precision)

    def _prior(self, state: Structure) -> Prior:
        """Return the prior of the free values, and the measurements."""
        count, values, precision = self.parameters[2], len(state.values), self._precision
        columns = np.arange(count - values, count)
        if self.measured is None:
            return Prior.of(precision * state.values, columns[:, None], precision[:, None], count)
        residuals, frames, derivatives = self.measured.linearize(state.rig_from_world)
        shape = len(residuals), POSE * frames.shape[1]
        measured = Prior.of(residuals, self.parameters[0][frames].reshape(shape), derivatives.reshape(shape), count)
        if not values:
            return measured
        of_values = csr_array((precision, columns, np.arange(values + 1)), (values, count))
        both = csr_array(vstack([of_values, csr_array(measured.derivatives)]))
        return Prior(np.append(precision * state.values, residuals), both)

    def covariances(self, state: Structure) -> tuple[BlockMatrix, Array]:
        """Return the covariances of the cameras, and of the points (P, 3, 3), at the optimum.

        Those between cameras are known if points connect them.

        The variances of the cameras are robust (P. Huber 1967; K.-Y. Liang and S. Zeger 1986): those of inverse
        information times the scatter of the gradients of all points times inverse information. In real images the
        errors of a point are correlated, and differ between points. With independent errors they are those of maximum
        likelihood.

        Raises
        ------
        LinAlgError
            If the observations do not determine the cameras.
        """
        squares = self.squared_residuals(state)
        used = np.isfinite(squares)
        weights = np.where(used, self.loss.information, 0.0)
        values = 2 * len(squares) - state.points.size
        freedom = max(values - self.parameters[2], 1)
        # Few observations of a point do not average the tails: its noise is the variance of the residuals.
        noise = self.loss.information * float(squares[used].sum()) / freedom
        return self.linearize(state, weights).covariances(self.linearize(state).gradients(), noise)

    def move(self, state: Structure, step: Array) -> Structure:
        """Return the structure moved by a step."""
        frames, sensors, count = self.parameters
        # The last entry is that of fixed parameters, whose column is -1.
        cameras, moves = np.append(step[:count], 0.0), step[count:].reshape(-1, 3)
        return Structure(
            _moved(state.rig_from_world, cameras[frames]),
            _moved(state.sensor_from_rig, cameras[sensors]) if self.refines_sensors else state.sensor_from_rig,
            state.points + moves,
            state.values + cameras[count - len(state.values) : count],
        )

    def with_refined_points(self, state: Structure) -> Structure:
        """Return the structure with the points of least cost for its cameras."""
        from omnisight.sfm._point_kernel import refine_points

        rays, points = self.rays_at(state), state.points.copy()
        poses, indices = (state.rig_from_world, state.sensor_from_rig), (self.starts, rays.frame, rays.sensor)
        of_loss, most = (self.loss.degrees, self.loss.sigma**2), int(np.diff(self.starts).max(initial=0))

        def work(first: int, last: int) -> None:
            memory = np.empty((most, 2)), np.empty((most, 2, 3))
            measured = rays.origins, rays.bearings, rays.axes
            refine_points(*poses, *indices, *measured, *of_loss, first, last, *memory, points)

        parallel_for(work, len(points), POINTS_PER_TASK)
        return replace(state, points=points)


@dataclass(frozen=True)
class _RefinedPoints:
    """The least-squares problem whose points are those of least cost wherever its cameras move."""

    bundle: Bundle

    def cost(self, state: Structure) -> float:
        return self.bundle.cost(state)

    def linearize(self, state: Structure) -> LinearizedBundle:
        return self.bundle.linearize(state)

    def move(self, state: Structure, step: Array) -> Structure:
        """Return the structure moved by a step; points that it moves through infinity, behind their rays, stay."""
        moved = self.bundle.move(state, step)
        behind = self.bundle.rays.point[np.isinf(self.bundle.squared_residuals(moved))]
        moved.points[behind] = state.points[behind]
        return self.bundle.with_refined_points(moved)


def adjust_bundle(
    bundle: Bundle, *, tolerance: float = TOLERANCE, watch: Callable[[int, float], None] | None = None
) -> Solution[Structure]:
    """Minimize the robust cost by Levenberg-Marquardt.

    B. Triggs et al., Bundle adjustment: a modern synthesis, 2000. After each step the points are refined one by one: 9
    steps instead of 54 are then needed for a map of 300 images, and the cost is lower (embedded point iterations of Y.
    Jeong et al., Pushing the envelope of modern methods for bundle adjustment, 2012). Points are not refined at the
    start: for wrong initial poses those of least cost can be far away or behind the cameras.
    """
    return minimize(
        _RefinedPoints(bundle),
        bundle.start,
        iterations=MAX_ITERATIONS,
        tolerance=tolerance,
        damping=INITIAL_DAMPING,
        watch=watch,
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
