"""Refining a camera and the poses of its boards together (bundle adjustment)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._bundle_kernel import weighted, weighted_lengths
from omnisight.calibration.domain_edge import project_clamped, project_clamped_jacobians
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.log_barrier import LogBarrier, limit_step, log_barrier
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State, outside_cost
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.levenberg_marquardt import Solution, blocked_by_bounds, minimize
from omnisight.optim.loss import Huber
from omnisight.optim.schur import GroupedNormal
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Share of the cost that steps must gain while it is not yet known how far off corners are.
UNSETTLED = 1e-5
# Along what corners hardly tell, costs fall slowly: a camera of 16 parameters and four images took 600 steps.
ITERATIONS = 400


@dataclass(frozen=True)
class Bundle:
    """The least-squares problem over `State`.

    Attributes
    ----------
    views
        The corners.
    freedom
        What moves beside the poses.
    spread
        What residuals are weighted with, and from which length on they count less.
    """

    views: Observations
    freedom: FreeParameters
    spread: ResidualWeights

    @property
    def loss(self) -> Huber:
        """What a weighted residual of a certain length costs."""
        return Huber(self.spread.threshold)

    @property
    def scale(self) -> float:
        """What corners cost that are as far off as corners are."""
        return len(self.views.pixels) * self.spread.sigma**2

    def cost(self, state: State) -> float:
        pixels, valid = state.model.project_numpy(points := state.points(self.views)[0])
        lost, most = np.flatnonzero(~valid), outside_cost(self.views)
        if len(lost):
            pixels[lost] = project_clamped(state.model, points[lost])
        lengths = weighted_lengths(pixels - self.views.pixels, self.spread.roots, most)
        lengths[lost] = np.minimum(lengths[lost], most)
        known = 0.5 * float(self._prior(state.model) @ state.model.params**2)
        before = self._wall(state)
        return self.loss.cost(lengths) + known + (before.cost if before else 0.0)

    def linearize(self, state: State) -> GroupedNormal:
        return self.completed(self.of_corners(state), state)

    def of_corners(self, state: State) -> GroupedNormal:
        """Give the normal equations of all the camera's parameters and the board's two bends, from the corners alone.

        Those of several parts of the views may be joined.
        """
        residuals, jacobian, cross, local, local_gradient = self.rows(state)
        return GroupedNormal(jacobian.T @ jacobian, cross, local, jacobian.T @ residuals, local_gradient)

    def rows(self, state: State) -> tuple[Array, Array, Array, Array, Array]:
        """Give the weighted residuals of the corners and what they depend on, as `_bundle_kernel.weighted` does."""
        points, turned = state.points(self.views)
        pixels, valid, d_point, d_params = state.model.project_with_jacobians(points)
        residuals, lost = pixels - self.views.pixels, np.flatnonzero(~valid)
        if len(lost):
            residuals[lost] = project_clamped(state.model, points[lost]) - self.views.pixels[lost]
            # What is so far off costs the same wherever it is.
            far = weighted_lengths(residuals[lost], self.spread.roots[lost], np.inf) > outside_cost(self.views)
            residuals[lost[far]] = np.nan
            near = lost[~far]
            d_point[near], d_params[near] = project_clamped_jacobians(state.model, points[near], d_params[valid])
        weights, view, bows = (self.spread.roots, self.spread.threshold), self.views.view_of_row, self.views.bows
        by_point, by_params = np.ascontiguousarray(d_point.T), np.ascontiguousarray(d_params.T)
        return weighted(residuals, by_point, by_params, *weights, turned, bows, view, state.rotations)

    def completed(self, corners: GroupedNormal, state: State) -> GroupedNormal:
        """Give the normal equations of what moves, what is known beforehand and walls among them."""
        prior = self._prior(state.model)
        information, gradient = np.diag(prior), prior * state.model.params
        if before := self._wall(state):
            information, gradient = information + before.hessian, gradient + before.gradient
        project_clamped = blocked_by_bounds(state.model.params, corners.shared_gradient[:-2] + gradient, *state.model.bounds)
        directions = self.directions.copy()
        directions[:-2][project_clamped] = 0.0
        known = directions[:-2]
        return corners.along(directions).with_prior(known.T @ information @ known, known.T @ gradient)

    def move(self, state: State, step: Array) -> State:
        camera, shared = self.freedom.directions.shape[1], self.freedom.count
        poses = step[shared:].reshape(-1, 6)
        return State(
            limit_step(state.model, self.freedom.directions @ step[:camera]) if camera else state.model,
            so3.exp(poses[:, :3]) @ state.rotations,
            state.translations + poses[:, 3:],
            state.warp + step[camera:shared] if self.freedom.warp else state.warp,
        )

    @cached_property
    def directions(self) -> Array:
        """(P + 2, F) the freedom's directions, in the parameters and the board's two bends."""
        moving = self.freedom.directions
        directions = np.zeros((len(moving) + 2, self.freedom.count))
        directions[:-2, : moving.shape[1]] = moving
        directions[-2:, moving.shape[1] :] = np.eye(2)[:, : 2 * self.freedom.warp]
        return directions

    def _wall(self, state: State) -> LogBarrier | None:
        """Give the log_barrier before a camera that moves."""
        return log_barrier(state, self.views, self.spread.sigma**2) if self.freedom.directions.shape[1] else None

    def _prior(self, model: CameraModel) -> Array:
        """Give what each parameter's square (P,) weighs, known beforehand to be near 0."""
        # It counts as residuals do, whose unit is sigma.
        return (self.spread.sigma / model.prior_sigmas) ** 2


def refine(
    state: State,
    views: Observations,
    *,
    freedom: FreeParameters | None = None,
    loss: str = "huber",
    spread: ResidualWeights | None = None,
    iterations: int = ITERATIONS,
    tolerance: float = 1e-9,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[State]:
    """Refine camera and poses to the least robust reprojection error.

    Parameters
    ----------
    state
        Where to begin.
    views
        The corners.
    freedom
        What moves beside the poses; what a calibration of the model estimates unless told otherwise.
    loss
        "huber", its threshold five robust standard deviations, estimated anew until it settles; or "squared", every
        corner alike.
    spread
        What corners count, if that is known; `loss` has no part in it then.
    iterations
        The most steps while corners count the same; where that is estimated anew, four times as many in all.
    tolerance, watch
        As in `minimize`.
    """
    freedom = FreeParameters.of(state.model) if freedom is None else freedom
    if spread is not None:
        problem = Bundle(views, freedom, spread)
        return minimize(problem, state, iterations=iterations, tolerance=tolerance, scale=problem.scale, watch=watch)
    used, share = 0, max(tolerance, UNSETTLED)
    spread = ResidualWeights.of(state, views, loss)
    while True:
        problem = Bundle(views, freedom, spread)
        solution = minimize(problem, state, iterations=iterations, tolerance=share, scale=problem.scale, watch=watch)
        used += solution.iterations
        state, before = solution.state, spread
        spread = ResidualWeights.of(state, views, loss)
        settled = spread.like(before)
        if (settled and share <= tolerance) or used >= 4 * iterations:
            return replace(solution, iterations=used)
        share = tolerance if settled else max(tolerance, UNSETTLED)
