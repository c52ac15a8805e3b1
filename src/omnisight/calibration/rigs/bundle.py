"""Joint refinement of the cameras, extrinsics, board poses, board warps and time offsets of a rig."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.bundle_adjustment import Bundle
from omnisight.calibration.log_barrier import limit_step
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.rigs.board_motion import BoardMotion, Eliminated, by_pose, eliminate, moved_motion
from omnisight.calibration.rigs.observations import RigObservations, RigPart
from omnisight.calibration.rigs.rig_free_parameters import RigFreeParameters
from omnisight.calibration.rigs.state import RigState
from omnisight.geometry import rotation as so3
from omnisight.optim.levenberg_marquardt import Solution, minimize
from omnisight.optim.schur import GroupedNormal
from omnisight.optim.tolerances import COMPARISON_TOLERANCE, FINAL_TOLERANCE

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MAX_ITERATIONS = 100
# Prior standard deviation of the time offsets: free-running cameras differ by up to an image interval.
TIME_OFFSET_SIGMA_S = 0.1
# Rounds in which the weights of the residuals are estimated anew.
MAX_WEIGHT_ROUNDS = 10


@dataclass(frozen=True)
class RigBundle:
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
        Standard deviations of the motion of the board in each view; None if it is at rest.
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
        weights = [ResidualWeights.estimate(state.part_state(part), part.observations) for part in observations.parts]
        return cls(observations, free_parameters, tuple(weights), motion)

    def without_outliers(self, state: RigState) -> RigObservations:
        """Return the observations without the corners whose residuals exceed the thresholds."""
        parts = [
            replace(part, observations=part.observations.at(np.flatnonzero(~outliers)))
            for part, weights in zip(self.observations.parts, self.weights, strict=True)
            for outliers in [weights.outliers(state.part_state(part), part.observations)]
        ]
        return replace(self.observations, parts=tuple(parts))

    @cached_property
    def bundles(self) -> list[Bundle]:
        """The problem of each part with board poses of its own."""
        return [
            Bundle(part.observations, self.free_parameters.of_part(part), weights)
            for part, weights in zip(self.observations.parts, self.weights, strict=True)
        ]

    @property
    def scale(self) -> float:
        """Expected cost of the inliers."""
        return float(sum(len(part.observations.pixels) for part in self.observations.parts))

    def cost(self, state: RigState) -> float:
        """Return the sum of the robust costs of all parts, each relative to the variance of its residuals."""
        prior = 0.5 * float((state.time_offsets**2).sum()) / TIME_OFFSET_SIGMA_S**2
        if self.motion is not None:
            prior += 0.5 * sum(float(((motion**2) @ self.motion.information).sum()) for motion in state.motion)
        return prior + sum(
            bundle.cost(state.part_state(part)) / weights.sigma**2
            for part, bundle, weights in zip(self.observations.parts, self.bundles, self.weights, strict=True)
        )

    def linearize(self, state: RigState) -> GroupedNormal:
        """Return the normal equations of all shared parameters and board poses."""
        count, groups = self.free_parameters.count, len(self.observations.groups)
        shared, shared_gradient = np.zeros((count, count)), np.zeros(count)
        cross, local, local_gradient = np.zeros((groups, count, 6)), np.zeros((groups, 6, 6)), np.zeros((groups, 6))
        for index, part in enumerate(self.observations.parts):
            columns, blocks = self.part_blocks(index, state)
            shared[np.ix_(columns, columns)] += blocks.shared
            shared_gradient[columns] += blocks.shared_gradient
            np.add.at(cross, (part.group[:, None], columns), blocks.cross)
            np.add.at(local, part.group, blocks.local)
            np.add.at(local_gradient, part.group, blocks.local_gradient)
        for camera, offset in enumerate(state.time_offsets):
            column = self.free_parameters.columns("time", camera, 1)
            shared[column, column] += TIME_OFFSET_SIGMA_S**-2
            shared_gradient[column] += offset * TIME_OFFSET_SIGMA_S**-2
        return GroupedNormal(shared, cross, local, shared_gradient, local_gradient)

    def part_blocks(self, index: int, state: RigState) -> tuple[Indices, GroupedNormal]:
        """Return the normal equations of one part, one group per view, and the columns of its shared parameters.

        A view depends on the shared parameters and the pose of its group through cam_from_board: with E and K the
        derivatives of its step (w, v) by both, the blocks of the single camera A, B, C become

            A' = [A, B E; E^T B^T, E^T C E],    B' = [B; E^T C] K,    C' = K^T C K
        """
        part, part_state = self.observations.parts[index], state.part_state(self.observations.parts[index])
        own = self.bundles[index].linearize(part_state)
        columns, by_shared, by_group = pose_derivatives(state, part, self.free_parameters)
        if (moved := self.eliminated_motion(index, own, state)) is not None:
            own = GroupedNormal(
                own.shared - moved.shared.sum(0),
                own.cross - moved.cross,
                own.local - moved.local,
                own.shared_gradient - moved.shared_gradient.sum(0),
                own.local_gradient - moved.local_gradient,
            )
        through = np.swapaxes(by_shared, 1, 2)
        pose_cross = through @ own.local
        corner = np.einsum("vpi,vij->pj", own.cross, by_shared)
        normal = GroupedNormal(
            np.block([[own.shared, corner], [corner.T, (pose_cross @ by_shared).sum(0)]]),
            np.concatenate([own.cross, pose_cross], axis=1) @ by_group,
            np.swapaxes(by_group, 1, 2) @ own.local @ by_group,
            np.concatenate([own.shared_gradient, np.einsum("vij,vj->i", through, own.local_gradient)]),
            (np.swapaxes(by_group, 1, 2) @ own.local_gradient[..., None])[..., 0],
        )
        scale = 1 / self.weights[index].sigma ** 2
        columns = np.concatenate([self.own_columns(part), columns])
        return columns, GroupedNormal(*(scale * block for block in vars(normal).values()))

    def eliminated_motion(self, index: int, normal: GroupedNormal, state: RigState) -> Eliminated | None:
        """Return the elimination of the motions of the board from the normal equations of a part; None without any."""
        if self.motion is None:
            return None
        part, variance = self.observations.parts[index], self.weights[index].sigma ** 2
        rotations, motion = state.cam_from_board(part).rotation, state.motion[part.camera]
        return eliminate(normal, rotations, part, motion, variance * self.motion.information)

    def own_columns(self, part: RigPart) -> Indices:
        """Return the columns of the camera and the board warp of a part."""
        free = self.free_parameters
        return np.concatenate([free.camera_columns(part.camera), free.columns("warp", part.board, 2)])

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
        motion = list(state.motion)
        for index, part in enumerate(self.observations.parts):
            own = self.bundles[index].corner_normal(state.part_state(part))
            moved = self.eliminated_motion(index, own, state)
            assert moved is not None
            motion[part.camera] = moved_motion(state.motion[part.camera], moved.step)
        return replace(state, motion=tuple(motion))


def pose_derivatives(state: RigState, part: RigPart, free: RigFreeParameters) -> tuple[Indices, Array, Array]:
    """Return the derivatives of cam_from_board of every view by what the views share, and by the pose of their group.

    Returns
    -------
    columns
        (Q,) the shared parameters that the poses depend on: extrinsics, pose of the board, time offset.
    by_shared
        (V, 6, Q) derivatives by them.
    by_group
        (V, 6, 6) derivatives by the pose of the group. All steps are those of `Pose.moved`.
    """
    sensor = state.sensor_from_rig.one(part.camera)
    in_rig, relation = state.rig_from_board(part), state.group_from_board.one(part.board)
    views = len(part)
    rotated = in_rig.translation @ sensor.rotation.T  # of the board's origin, in the camera's axes
    by_sensor = np.zeros((views, 6, 6))
    by_sensor[:, range(6), range(6)] = 1.0
    by_sensor[:, 3:, :3] = -so3.hat(rotated)
    # Rotating the group moves the origin of the board by w x (R_g t_b).
    group_rotation = in_rig.rotation @ relation.rotation.T
    arm = relation.translation @ np.swapaxes(group_rotation, 1, 2)
    by_group = np.zeros((views, 6, 6))
    by_group[:, :3, :3] = by_group[:, 3:, 3:] = sensor.rotation
    by_group[:, 3:, :3] = -sensor.rotation @ so3.hat(arm)
    by_board = np.zeros((views, 6, 6))
    by_board[:, :3, :3] = by_board[:, 3:, 3:] = sensor.rotation @ group_rotation
    by_time = by_group @ state.velocities[part.group][..., None]
    turn = so3.exp((part.delays + state.time_offsets[part.camera])[:, None] * state.velocities[part.group, :3])
    by_group[:, :, :3] = by_group[:, :, :3] @ turn  # the group turns before it moves on
    blocks = (
        (free.extrinsic_columns(part.camera), by_sensor),
        (free.columns("board", part.board, 6), by_board),
        (free.columns("time", part.camera, 1), by_time),
    )
    if state.motion:
        moved = by_pose(state.cam_from_still_board(part), part, state.motion[part.camera])
        by_group = moved @ by_group
        blocks = tuple((columns, moved @ block) for columns, block in blocks)
    used = [(columns, block) for columns, block in blocks if len(columns)]
    if not used:
        return np.arange(0), np.zeros((views, 6, 0)), by_group
    return np.concatenate([c for c, _ in used]), np.concatenate([b for _, b in used], axis=2), by_group


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
        Standard deviations of the motion of the board in each view.
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
