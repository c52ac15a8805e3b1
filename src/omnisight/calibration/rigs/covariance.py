"""Covariance of the extrinsics and the cameras of a rig, from corner noise and from the scatter between images."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.covariance import CHANCE_SIGMA, MAX_LEVERAGE
from omnisight.calibration.rigs.bundle import RigBundle
from omnisight.calibration.rigs.state import RigState
from omnisight.display import Displayed
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigCovariance(Displayed):
    """Covariance of what a rig calibration estimates besides the board poses.

    Attributes
    ----------
    shared
        (S, S) covariance of the shared parameters, in the order of `RigFreeParameters`.
    extrinsics
        (6 C, 6 C) covariance of `sensor_from_rig`, as steps of `Pose.moved`; zero for the first camera.
    cameras
        For each camera (P, P) that of its parameters.
    inflation
        Ratio of the variance of the estimates to that due to corner noise, contained in the others.
    """

    shared: Array
    extrinsics: Array
    cameras: tuple[Array, ...]
    inflation: float


def rig_covariance(problem: RigBundle, state: RigState, at_least: float = 1.0) -> RigCovariance:
    """Return the covariance at the minimum of a problem.

    The covariance due to corner noise, corrected for the degrees of freedom (Triggs et al., Bundle adjustment: a modern
    synthesis, 2000, sec. 9), is multiplied by the excess scatter between groups as in `camera_covariance`.
    """
    observations, free = problem.observations, problem.free_parameters
    normal = problem.linearize(state)
    used = np.flatnonzero(observations.seen().any(0))
    measured = sum(part.observations.pixels.size for part in observations.parts)
    variance = measured / max(measured - free.count - 6 * len(used), 1)
    inflation = max(variance_inflation(problem, state, normal, variance), at_least)
    shared = inflation * variance * normal.shared_covariance()
    cameras = len(observations.names)
    extrinsics = np.zeros((6 * cameras, 6 * cameras))
    columns = [free.extrinsic_columns(c) for c in range(cameras)]
    for a, rows in enumerate(columns):
        for b, others in enumerate(columns):
            if len(rows) and len(others):
                extrinsics[6 * a : 6 * a + 6, 6 * b : 6 * b + 6] = shared[np.ix_(rows, others)]
    own = [free.camera_columns(c) for c in range(cameras)]
    by_camera = tuple(d @ shared[np.ix_(c, c)] @ d.T for d, c in zip(free.cameras, own, strict=True))
    return RigCovariance(shared, extrinsics, by_camera, inflation)


def variance_inflation(problem: RigBundle, state: RigState, normal: GroupedNormal, variance: float) -> float:
    """Return the factor by which the variance of the estimates exceeds that due to corner noise; at least 1.

    It is that of `calibration.covariance.variance_inflation`, with a group (simultaneous images) as the independent
    sample: the errors of the corners of one board are common to all cameras that observe it.
    """
    root = normal.half_covariance()
    count = root.shape[1]
    if not count:
        return 1.0
    to_minimum = -root @ (root.T @ normal.reduced()[1])
    compared, scattered, samples = 0.0, 0.0, 0
    for part, gradient in _parts_by_group(problem, state, normal):
        values, vectors = np.linalg.eigh(root.T @ part @ root)
        leverage = np.where(values > MAX_LEVERAGE, 0.0, np.maximum(values, 0.0))
        score = np.where(leverage > 0, vectors.T @ (root.T @ (gradient + part @ to_minimum)), 0.0)
        compared += float(leverage.sum())
        scattered += float((score**2 / (1 - leverage)).sum())
        samples += 1
    excess = (scattered / variance + max(count - compared, 0.0)) / count - 1.0
    chance = CHANCE_SIGMA * np.sqrt(2 / max(samples - 1, 1))
    return 1.0 + max(excess - chance**2 / excess, 0.0) if excess > 0 else 1.0


def _parts_by_group(problem: RigBundle, state: RigState, normal: GroupedNormal) -> list[tuple[Array, Array]]:
    """Return each group's part of the normal equations (S, S) and of the gradient (S,), its pose eliminated."""
    inverse = np.linalg.pinv(normal.local, rcond=1e-14, hermitian=True)
    gains = normal.cross @ inverse
    sums, gradients = _sums_by_group(problem, state)
    return [
        (sums[g] - gains[g] @ normal.cross[g].T, gradients[g] - gains[g] @ normal.local_gradient[g])
        for g in np.flatnonzero(problem.observations.seen().any(0))
    ]


def _sums_by_group(problem: RigBundle, state: RigState) -> tuple[Array, Array]:
    """Return the normal equations of the shared parameters (G, S, S) and their gradient (G, S) by group."""
    count, groups = problem.free_parameters.count, len(problem.observations.groups)
    sums, gradients = np.zeros((groups, count, count)), np.zeros((groups, count))
    blocks = problem.blocks(state)
    for part, block in zip(problem.observations.parts, blocks, strict=True):
        for view, (group, rows) in enumerate(zip(part.group, part.observations.groups, strict=True)):
            shared, gradient = block.shared(slice(2 * rows.start, 2 * rows.stop), slice(view, view + 1))
            sums[group][np.ix_(block.columns, block.columns)] += shared
            gradients[group, block.columns] += gradient
    if problem.motion is not None:
        motion = problem.motion_normal(blocks, state)
        gain = motion.by_shared @ np.linalg.inv(motion.information)
        np.subtract.at(sums, motion.group, gain @ np.swapaxes(motion.by_shared, 1, 2))
        np.add.at(gradients, motion.group, np.einsum("epi,ei->ep", motion.by_shared, motion.steps))
    return sums, gradients
