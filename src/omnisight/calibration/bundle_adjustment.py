"""Bundle adjustment: joint refinement of a camera model, board poses and board warp."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._bundle_kernel import normal_equation_blocks, whitened_lengths
from omnisight.calibration.domain_edge import project_clamped, project_clamped_jacobians
from omnisight.calibration.estimation_options import Loss
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.log_barrier import LogBarrier, limit_step, log_barrier
from omnisight.calibration.residual_weights import ResidualWeights
from omnisight.calibration.state import State, outside_cost
from omnisight.geometry import rotation as so3
from omnisight.models import Projector
from omnisight.optim.levenberg_marquardt import Solution, blocked_by_bounds, minimize
from omnisight.optim.loss import Huber
from omnisight.optim.schur import GroupedNormal
from omnisight.optim.tolerances import COMPARISON_TOLERANCE, FINAL_TOLERANCE
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Along nearly unobservable directions the cost falls slowly: a camera of 16 parameters and four images took 600 steps.
MAX_ITERATIONS = 400


@dataclass(frozen=True)
class Bundle:
    """The least-squares problem over `State`; camera and warp are shared, poses are eliminated by the Schur complement.

    Attributes
    ----------
    observations
        Board points and pixels.
    free_parameters
        What is estimated besides the poses.
    weights
        Whitening and Huber threshold of the residuals.
    prior_share
        Share of the prior of the camera that is part of this problem; below 1 if it is one of several of a camera.
    """

    observations: Observations
    free_parameters: FreeParameters
    weights: ResidualWeights
    prior_share: float = 1.0

    @property
    def scale(self) -> float:
        """Expected cost of the inliers."""
        return len(self.observations.pixels) * self.weights.sigma**2

    @property
    def moves_camera(self) -> bool:
        """Whether parameters of the camera are estimated."""
        return bool(self.free_parameters.directions.shape[1])

    def cost(self, state: State) -> float:
        """Return the robust cost with priors and barrier; points outside the domain are clamped to its edge."""
        pixels, valid = state.model.project_numpy(points := state.points(self.observations)[0])
        outside, limit = np.flatnonzero(~valid), outside_cost(self.observations)
        if len(outside):
            pixels[outside] = project_clamped(state.model, points[outside])
        lengths = whitened_lengths(pixels - self.observations.pixels, self.weights.whitening, limit)
        lengths[outside] = np.minimum(lengths[outside], limit)
        prior = 0.5 * float(self._prior_information(state.model) @ state.model.params**2)
        barrier = self._barrier(state)
        if self.free_parameters.bend_sigma:
            prior += 0.5 * self._bend_information * float((state.bends_or_zero**2).sum())
        return Huber(self.weights.threshold).cost(lengths) + prior + (barrier.cost if barrier else 0.0)

    def linearize(self, state: State) -> GroupedNormal:
        """Return the normal equations of all free parameters and poses."""
        return self.with_priors(self.corner_normal(state, by_camera=self.moves_camera), state)

    def corner_normal(self, state: State, *, by_camera: bool = True) -> GroupedNormal:
        """Return the normal equations of all camera parameters and the warp, from the corners alone.

        Those of disjoint sets of views can be joined. Without `by_camera` those of the camera parameters are zero.
        """
        residuals, jacobian, cross, local, local_gradient = self.blocks(state, by_camera=by_camera)
        return GroupedNormal(jacobian.T @ jacobian, cross, local, jacobian.T @ residuals, local_gradient)

    def blocks(self, state: State, *, by_camera: bool = True) -> tuple[Array, Array, Array, Array, Array]:
        """Return weighted residuals and the blocks of their Jacobian, see `_bundle_kernel.normal_equation_blocks`.

        Without `by_camera` the derivatives by the camera parameters are zero.
        """
        o, weights = self.observations, self.weights
        points, rotated = state.points(o)
        if by_camera:
            pixels, valid, d_point, d_params = state.model.project_with_jacobians(points)
        else:
            pixels, valid, d_point = state.model.project_with_point_jacobian(points)
            d_params = np.zeros((state.model.params.size, 2, len(points))).T
        residuals, outside = pixels - o.pixels, np.flatnonzero(~valid)
        if len(outside):
            residuals[outside] = project_clamped(state.model, points[outside]) - o.pixels[outside]
            # Beyond `outside_cost` the cost is constant, so these points have no derivative.
            far = whitened_lengths(residuals[outside], weights.whitening[outside], np.inf) > outside_cost(o)
            residuals[outside[far]] = np.nan
            near = outside[~far]
            d_point[near], d_params[near] = project_clamped_jacobians(state.model, points[near], d_params[valid])
        by_point, by_params = np.ascontiguousarray(d_point.T), np.ascontiguousarray(d_params.T)
        weighting = weights.whitening, weights.threshold
        bends, terms = state.bends_or_zero, self.free_parameters.per_view - 6
        sheet = o.sheet, o.sheet_size, bends, terms
        blocks = normal_equation_blocks(
            residuals, by_point, by_params, *weighting, rotated, o.warp_basis, *sheet, o.view_of_row, state.rotations
        )
        if terms:
            _, _, _, local, local_gradient = blocks
            local[:, range(6, 9), range(6, 9)] += self._bend_information
            local_gradient[:, 6:] += self._bend_information * bends
        return blocks

    def with_priors(self, corners: GroupedNormal, state: State) -> GroupedNormal:
        """Return the normal equations of the free parameters, with priors and barrier added to those of the corners."""
        information, gradient = self.camera_priors(state)
        active = blocked_by_bounds(state.model.params, corners.shared_gradient[:-2] + gradient, *state.model.bounds)
        directions = self.directions.copy()
        directions[:-2][active] = 0.0
        camera = directions[:-2]
        return corners.along(directions).with_prior(camera.T @ information @ camera, camera.T @ gradient)

    def camera_priors(self, state: State) -> tuple[Array, Array]:
        """Return the information (P, P) of priors and barrier on the camera parameters, and their gradient (P,)."""
        prior = self._prior_information(state.model)
        information, gradient = np.diag(prior), prior * state.model.params
        if barrier := self._barrier(state):
            return information + barrier.hessian, gradient + barrier.gradient
        return information, gradient

    def move(self, state: State, step: Array) -> State:
        """Return the state moved by a step of the free parameters and of the poses, kept within bounds."""
        camera, shared = self.free_parameters.directions.shape[1], self.free_parameters.count
        poses = step[shared:].reshape(-1, self.free_parameters.per_view)
        return State(
            limit_step(state.model, self.free_parameters.directions @ step[:camera]) if camera else state.model,
            so3.exp(poses[:, :3]) @ state.rotations,
            state.translations + poses[:, 3:6],
            state.warp + step[camera:shared] if self.free_parameters.warp else state.warp,
            state.bends_or_zero + poses[:, 6:] if self.free_parameters.bend_sigma else state.bends,
        )

    @cached_property
    def directions(self) -> Array:
        """(P + 2, F) the free directions in the space of camera parameters and warp."""
        camera = self.free_parameters.directions
        directions = np.zeros((len(camera) + 2, self.free_parameters.count))
        directions[:-2, : camera.shape[1]] = camera
        directions[-2:, camera.shape[1] :] = np.eye(2)[:, : 2 * self.free_parameters.warp]
        return directions

    def _barrier(self, state: State) -> LogBarrier | None:
        return log_barrier(state, self.observations, self.weights.sigma**2) if self.moves_camera else None

    @property
    def _bend_information(self) -> float:
        """Weight of the squared bends, in the unit of the residuals."""
        return (self.weights.sigma / self.free_parameters.bend_sigma) ** 2

    def _prior_information(self, model: Projector) -> Array:
        """Return the weight (P,) of each squared parameter, from its prior standard deviation about 0."""
        # In the unit of the residuals, sigma.
        return self.prior_share * (self.weights.sigma / model.prior_sigmas) ** 2


def refine(
    state: State,
    observations: Observations,
    *,
    free_parameters: FreeParameters | None = None,
    loss: Loss = "huber",
    weights: ResidualWeights | None = None,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = FINAL_TOLERANCE,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[State]:
    """Refine camera and poses to the least robust reprojection error.

    Parameters
    ----------
    state
        Initial state.
    observations
        Board points and pixels.
    free_parameters
        What is estimated besides the poses; the defaults of the model if omitted.
    loss
        "huber" with a threshold of five robust standard deviations, re-estimated until it converges; or "squared".
    weights
        Weights to use unchanged; `loss` is ignored then.
    iterations
        Maximum number of steps with constant weights; four times as many in total while they are re-estimated.
    tolerance, watch
        As in `minimize`.
    """
    free_parameters = FreeParameters.of(state.model) if free_parameters is None else free_parameters
    if weights is not None:
        problem = Bundle(observations, free_parameters, weights)
        return minimize(problem, state, iterations=iterations, tolerance=tolerance, scale=problem.scale, watch=watch)
    used, current = 0, max(tolerance, COMPARISON_TOLERANCE)
    weights = ResidualWeights.estimate(state, observations, loss)
    while True:
        problem = Bundle(observations, free_parameters, weights)
        solution = minimize(problem, state, iterations=iterations, tolerance=current, scale=problem.scale, watch=watch)
        used += solution.iterations
        state, previous = solution.state, weights
        weights = ResidualWeights.estimate(state, observations, loss)
        converged = weights.is_close(previous)
        if (converged and current <= tolerance) or used >= 4 * iterations:
            return replace(solution, iterations=used)
        current = tolerance if converged else max(tolerance, COMPARISON_TOLERANCE)
