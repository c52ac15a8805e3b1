"""Joint refinement of the cameras, extrinsics, board poses, board warps and time offsets of a rig."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.log_barrier import limit_step
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.rigs.board_motion import BoardMotion, MotionNormal, moved_motion
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.pose_derivatives import pose_derivatives
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.state import RigState
from omnisight.display import Displayed
from omnisight.optim.levenberg_marquardt import Solution, blocked_by_bounds, minimize
from omnisight.optim.schur import GroupedNormal
from omnisight.optim.tolerances import COMPARISON_TOLERANCE, FINAL_TOLERANCE

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Levenberg-Marquardt steps, and rounds in which the weights of the residuals are estimated anew.
MAX_ITERATIONS, MAX_WEIGHT_ROUNDS = 100, 10
# Prior standard deviation of the time offsets: free-running cameras differ by up to an image interval.
TIME_OFFSET_SIGMA_S = 0.1


class PartBlocks(NamedTuple):
    """Blocks of the normal equations of one part, for residuals of unit variance.

    With the camera parameters and the warp of a part in the columns F1, and what the board poses depend on in Q:

    Attributes
    ----------
    own, posed
        Columns (F1,) and (Q,) of the shared parameters.
    residuals, jacobian
        (2N,) and (2N, F1).
    cross, local, gradient
        (V, F1, 6), (V, 6, 6) and (V, 6) by the step of cam_from_board of each view.
    by_shared
        (V, 6, Q) derivative of that step by the shared parameters.
    by_group, by_motion
        (V, 6, 6) by the pose of the group and by the motion of the exposure.
    """

    own: Indices
    posed: Indices
    residuals: Array
    jacobian: Array
    cross: Array
    local: Array
    gradient: Array
    by_shared: Array
    by_group: Array
    by_motion: Array

    @property
    def columns(self) -> Indices:
        """Columns of all shared parameters."""
        return np.concatenate([self.own, self.posed])

    def coupling(self, derivative: Array) -> Array:
        """Return the blocks (V, F1 + Q, 6) by the shared parameters and a step with a derivative (V, 6, 6)."""
        posed = np.swapaxes(self.by_shared, 1, 2) @ self.local
        return np.concatenate([self.cross, posed], axis=1) @ derivative

    def shared(self, rows: slice, views: slice) -> tuple[Array, Array]:
        """Return the normal equations of the shared parameters from some views and their rows, and the gradient."""
        jacobian, by_shared = self.jacobian[rows], self.by_shared[views]
        corner = np.einsum("vpi,vij->pj", self.cross[views], by_shared)
        through = np.swapaxes(by_shared, 1, 2)
        normal = np.block(
            [[jacobian.T @ jacobian, corner], [corner.T, (through @ self.local[views] @ by_shared).sum(0)]]
        )
        posed = np.einsum("vij,vj->i", through, self.gradient[views])
        return normal, np.concatenate([jacobian.T @ self.residuals[rows], posed])


@dataclass(frozen=True)
class RigBundle(Displayed):
    """The least-squares problem over `RigState`; the board poses are eliminated by the Schur complement.

    The residuals of each part are divided by their own standard deviation.

    Attributes
    ----------
    observations
        Boards and pixels of all cameras.
    free_parameters
        What is estimated.
    weights
        Whitening, standard deviation and Huber threshold of every part.
    motion
        Standard deviations of the motion of the boards in each exposure; None if they are at rest.
    """

    observations: RigObservations
    free_parameters: RigFreeParameters
    weights: tuple[ResidualWeights, ...]
    motion: BoardMotion | None = None

    @classmethod
    def at(
        cls,
        state: RigState,
        observations: RigObservations,
        free_parameters: RigFreeParameters,
        motion: BoardMotion | None = None,
    ) -> Self:
        """Return the problem with the weights estimated at a state."""
        weights = [
            ResidualWeights.estimate(own, part.observations)
            for part, own in zip(observations.parts, state.part_states(observations), strict=True)
        ]
        return cls(observations, free_parameters, tuple(weights), motion)

    def without_outliers(self, state: RigState) -> RigObservations:
        """Return the observations without the corners whose residuals exceed the thresholds."""
        states = state.part_states(self.observations)
        parts = [
            replace(part, observations=part.observations.at(np.flatnonzero(~outliers)))
            for part, own, weights in zip(self.observations.parts, states, self.weights, strict=True)
            for outliers in [weights.outliers(own, part.observations)]
        ]
        return replace(self.observations, parts=tuple(parts))

    @cached_property
    def bundles(self) -> list[Bundle]:
        """The problem of each part with board poses of its own."""
        count = np.bincount([part.camera for part in self.observations.parts])
        return [
            Bundle(part.observations, self.free_parameters.of_part(part), weights, 1 / int(count[part.camera]))
            for part, weights in zip(self.observations.parts, self.weights, strict=True)
        ]

    @cached_property
    def exposures(self) -> list[Indices]:
        """For each part (V,) the exposures of its views."""
        return [self.observations.exposures_of(part) for part in self.observations.parts]

    @property
    def scale(self) -> float:
        """Expected cost of the inliers."""
        return float(sum(len(part.observations.pixels) for part in self.observations.parts))

    def cost(self, state: RigState) -> float:
        """Return the sum of the robust costs of all parts, each relative to the variance of its residuals."""
        prior = 0.5 * float((state.time_offsets**2).sum()) / TIME_OFFSET_SIGMA_S**2
        if self.motion is not None and state.motion is not None:
            prior += 0.5 * float((state.motion**2 @ self.motion.information).sum())
        states = state.part_states(self.observations)
        return prior + sum(
            bundle.cost(own) / weights.sigma**2
            for own, bundle, weights in zip(states, self.bundles, self.weights, strict=True)
        )

    def linearize(self, state: RigState) -> GroupedNormal:
        """Return the normal equations of all shared parameters and group poses, the motions eliminated."""
        blocks = self.blocks(state)
        normal = self._normal(blocks)
        if self.motion is not None:
            normal = self.motion_normal(blocks, state).eliminated_from(normal)
        return self._with_priors(normal, state)

    def blocks(self, state: RigState) -> list[PartBlocks]:
        """Return the blocks of the normal equations of each part, from the corners alone.

        A view depends on the shared parameters, the pose of its group and the motion of its exposure through
        cam_from_board: with E and K the derivatives of its step by the former two, and A, B and C the blocks of the
        single camera, those of the rig are

            A' = [A, B E; E^T B^T, E^T C E],    B' = [B; E^T C] K,    C' = K^T C K
        """
        found, free = list[PartBlocks](), self.free_parameters
        for index, part in enumerate(self.observations.parts):
            bundle, exposures = self.bundles[index], self.exposures[index]
            of_part, scale = state.part_state(part, exposures), 1 / self.weights[index].sigma
            residuals, jacobian, cross, local, gradient = bundle.blocks(of_part, by_camera=bundle.moves_camera)
            derivatives = pose_derivatives(state, part, exposures, free)
            found.append(
                PartBlocks(
                    np.concatenate([free.camera_columns(part.camera), free.columns("warp", part.board, 2)]),
                    derivatives.columns,
                    scale * residuals,
                    scale * jacobian @ bundle.directions,
                    scale**2 * (bundle.directions.T @ cross),
                    scale**2 * local,
                    scale**2 * gradient,
                    *derivatives[1:],
                )
            )
        return found

    def _normal(self, blocks: Sequence[PartBlocks]) -> GroupedNormal:
        """Return the normal equations of all parts, from the corners alone."""
        count, groups = self.free_parameters.count, len(self.observations.groups)
        shared, shared_gradient = np.zeros((count, count)), np.zeros(count)
        cross, local, local_gradient = np.zeros((groups, count, 6)), np.zeros((groups, 6, 6)), np.zeros((groups, 6))
        for part, block in zip(self.observations.parts, blocks, strict=True):
            columns, back = block.columns, np.swapaxes(block.by_group, 1, 2)
            normal, gradient = block.shared(slice(None), slice(None))
            shared[np.ix_(columns, columns)] += normal
            shared_gradient[columns] += gradient
            np.add.at(cross, (part.group[:, None], columns), block.coupling(block.by_group))
            np.add.at(local, part.group, back @ block.local @ block.by_group)
            np.add.at(local_gradient, part.group, (back @ block.gradient[..., None])[..., 0])
        return GroupedNormal(shared, cross, local, shared_gradient, local_gradient)

    def motion_normal(self, blocks: Sequence[PartBlocks], state: RigState) -> MotionNormal:
        """Return the normal equations of the motions of all exposures."""
        assert self.motion is not None
        assert state.motion is not None
        count, total = self.free_parameters.count, len(state.motion)
        information = np.tile(np.diag(self.motion.information), (total, 1, 1))
        by_shared, by_group = np.zeros((total, count, 6)), np.zeros((total, 6, 6))
        gradient = self.motion.information * state.motion
        for exposures, block in zip(self.exposures, blocks, strict=True):
            back, through = np.swapaxes(block.by_motion, 1, 2), block.local @ block.by_motion
            np.add.at(information, exposures, back @ through)
            np.add.at(by_shared, (exposures[:, None], block.columns), block.coupling(block.by_motion))
            np.add.at(by_group, exposures, np.swapaxes(block.by_group, 1, 2) @ through)
            np.add.at(gradient, exposures, (back @ block.gradient[..., None])[..., 0])
        return MotionNormal(information, by_shared, by_group, gradient, self.observations.exposures[1])

    def _with_priors(self, normal: GroupedNormal, state: RigState) -> GroupedNormal:
        """Return normal equations with the priors of cameras and time offsets, without directions blocked by bounds."""
        free, directions = self.free_parameters, np.eye(self.free_parameters.count)
        information, gradient = np.zeros_like(normal.shared), np.zeros_like(normal.shared_gradient)
        for camera, camera_directions in enumerate(free.cameras):
            columns, model = free.camera_columns(camera), state.models[camera]
            if not len(columns):
                continue
            hessian, slope = self._camera_priors(camera, state)
            along = normal.shared_gradient[columns] + camera_directions.T @ slope
            downhill = camera_directions @ along
            blocked = blocked_by_bounds(model.params, downhill, *model.bounds)
            directions[np.ix_(columns, columns)] -= np.diag(camera_directions[blocked].any(0).astype(float))
            information[np.ix_(columns, columns)] = camera_directions.T @ hessian @ camera_directions
            gradient[columns] = camera_directions.T @ slope
        for camera, offset in enumerate(state.time_offsets):
            column = free.columns("time", camera, 1)
            information[column, column] = TIME_OFFSET_SIGMA_S**-2
            gradient[column] = offset * TIME_OFFSET_SIGMA_S**-2
        return normal.with_prior(information, gradient).along(directions)

    def _camera_priors(self, camera: int, state: RigState) -> tuple[Array, Array]:
        """Return information and gradient of the priors and barriers of a camera, for residuals of unit variance."""
        count = len(state.models[camera].params)
        information, gradient = np.zeros((count, count)), np.zeros(count)
        for index in self.observations.parts_of(camera):
            own = state.part_state(self.observations.parts[index], self.exposures[index])
            hessian, slope = self.bundles[index].camera_priors(own)
            information += hessian / self.weights[index].sigma ** 2
            gradient += slope / self.weights[index].sigma ** 2
        return information, gradient

    def move(self, state: RigState, step: Array) -> RigState:
        """Return the state moved by a step of the shared parameters and of the poses of all groups."""
        free, cameras, boards = self.free_parameters, len(state.models), len(state.warps)

        def steps(kind: str, count: int, size: int) -> Array:
            found = np.zeros((count, size))
            for k in range(count):
                columns = free.columns(kind, k, size)
                if len(columns):
                    found[k] = step[columns]
            return found

        models = [
            limit_step(model, directions @ step[free.camera_columns(c)]) if directions.shape[1] else model
            for c, (model, directions) in enumerate(zip(state.models, free.cameras, strict=True))
        ]
        moved = replace(
            state,
            models=tuple(models),
            sensor_from_rig=state.sensor_from_rig.moved(steps("extrinsics", cameras, 6)),
            rig_from_group=state.rig_from_group.moved(step[free.count :].reshape(-1, 6)),
            group_from_board=state.group_from_board.moved(steps("board", boards, 6)),
            warps=state.warps + steps("warp", boards, 2),
            time_offsets=state.time_offsets + steps("time", cameras, 1)[:, 0],
        )
        return moved if self.motion is None else self.with_best_motion(moved)

    def with_best_motion(self, state: RigState) -> RigState:
        """Return the state with the motions of the boards that minimize the linearized cost."""
        assert state.motion is not None
        normal = self.motion_normal(self.blocks(state), state)
        return replace(state, motion=moved_motion(state.motion, normal.steps))


def refine_rig(
    state: RigState,
    observations: RigObservations,
    free_parameters: RigFreeParameters,
    *,
    motion: BoardMotion | None = None,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = FINAL_TOLERANCE,
) -> Solution[RigState]:
    """Refine a rig to the least robust reprojection error of all cameras.

    The weights of the residuals are estimated anew until they converge.

    Parameters
    ----------
    state
        Initial state.
    observations
        Boards and pixels of all cameras.
    free_parameters
        What is estimated.
    motion
        Standard deviations of the motion of the boards in each exposure.
    iterations
        Maximum number of steps with constant weights.
    tolerance
        As in `minimize`.
    """
    current, rounds = max(tolerance, COMPARISON_TOLERANCE), 0
    while True:
        problem = RigBundle.at(state, observations, free_parameters, motion)
        solution = minimize(problem, state, iterations=iterations, tolerance=current, scale=problem.scale)
        state, rounds = solution.state, rounds + 1
        after = RigBundle.at(state, observations, free_parameters).weights
        converged = all(new.is_close(old) for new, old in zip(after, problem.weights, strict=True))
        if (converged and current <= tolerance) or rounds == MAX_WEIGHT_ROUNDS:
            return solution
        current = tolerance if converged else current


def pose_groups(
    state: RigState,
    observations: RigObservations,
    weights: Sequence[ResidualWeights],
    motion: BoardMotion | None = None,
) -> RigState:
    """Return the state with the poses of all groups, and the motions of the boards, refined; the rest is constant."""
    none = tuple(np.zeros((len(model.params), 0)) for model in state.models)
    fixed = RigFreeParameters(none, (False,) * len(state.warps), extrinsics=False)
    problem = RigBundle(observations, fixed, tuple(weights), motion)
    return minimize(
        problem, state, iterations=MAX_ITERATIONS, tolerance=COMPARISON_TOLERANCE, scale=problem.scale
    ).state
