"""Held-out error of a rig: the residuals of simultaneous images that did not take part in its calibration."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.candidate import FOLDS
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.rigs.bundle import RigBundle, pose_groups
from omnisight.calibration.rigs.observations import RigObservations
from omnisight.calibration.rigs.state import RigState
from omnisight.optim.levenberg_marquardt import minimize
from omnisight.optim.tolerances import COMPARISON_TOLERANCE

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


def held_out_lengths(problem: RigBundle, state: RigState) -> list[Array]:
    """Return the residual length (N,), px, of every corner of each part when its group is held out.

    The rig is refined on four fifths of the groups; of the others only the board poses are estimated. So the error
    contains that of the extrinsics, which calibrating each camera alone does not measure.
    """
    observations = problem.observations
    lengths = [np.full(len(part.observations.pixels), np.nan) for part in observations.parts]
    used = np.flatnonzero(observations.seen().any(0))
    fold = np.full(len(observations.groups), -1)
    fold[used] = np.arange(len(used)) % FOLDS
    for k in range(min(FOLDS, len(used))):
        trained, left_out = (fold >= 0) & (fold != k), fold == k
        others, weights = _subset(observations, problem.weights, trained)
        part_problem = RigBundle(others, problem.free_parameters, weights, problem.motion)
        start = state.of_groups(observations, trained)
        fitted = minimize(part_problem, start, tolerance=COMPARISON_TOLERANCE, scale=part_problem.scale).state
        own, weights = _subset(observations, problem.weights, left_out)
        start = state.of_groups(observations, left_out)
        posed = replace(fitted, rig_from_group=start.rig_from_group, velocities=start.velocities, motion=start.motion)
        posed = pose_groups(posed, own, weights, problem.motion)
        for target, part, found in zip(lengths, observations.parts, posed.lengths(own), strict=True):
            views = np.flatnonzero(left_out[part.group])
            target[part.observations.rows(views)] = found
    return lengths


def _subset(
    observations: RigObservations, weights: tuple[ResidualWeights, ...], kept: Bools
) -> tuple[RigObservations, tuple[ResidualWeights, ...]]:
    """Return observations and weights of some of the groups (G,)."""
    rows = [part.observations.rows(np.flatnonzero(kept[part.group])) for part in observations.parts]
    return observations.of_groups(kept), tuple(w.subset(r) for w, r in zip(weights, rows, strict=True))
