"""Refining a camera and the poses of its boards together (bundle adjustment)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.spread import Spread
from omnisight.calibrate.state import State
from omnisight.calibrate.views import BoardViews
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.dense import held_back
from omnisight.optim.levenberg_marquardt import Solution, minimise
from omnisight.optim.loss import Huber
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]


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

    views: BoardViews
    freedom: Freedom
    spread: Spread

    @property
    def loss(self) -> Huber:
        """What a weighted residual of a certain length costs."""
        return Huber(self.spread.threshold)

    def cost(self, state: State) -> float:
        expected = 0.5 * (self._prior(state.model) * state.model.params**2).sum()
        return self.loss.cost(state.lengths(self.views, self.spread.roots)) + float(expected)

    def linearise(self, state: State) -> GroupedNormal:
        points, turned = state.points(self.views)
        pixels, valid, d_point, d_params = state.model.project_with_jacobians(points)
        residuals = pixels - self.views.pixels
        outside = ~valid | ~np.isfinite(d_params).all((1, 2))
        residuals[outside], d_point[outside], d_params[outside] = 0.0, 0.0, 0.0
        residuals = np.einsum("nij,nj->ni", self.spread.roots, residuals)
        root = np.sqrt(self.loss.weight(np.linalg.norm(residuals, axis=1)))[:, None]
        weight = self.spread.roots * root[..., None]
        residuals = residuals * root
        d_point, d_params = weight @ d_point, weight @ d_params
        # x_c = exp(w) R x + t + v:  dx_c/dw = -[R x]_x, and a row vector times -[a]_x is a x row.
        d_local = np.concatenate([np.cross(turned[:, None, :], d_point), d_point], -1)
        prior, params = self._prior(state.model), state.model.params
        gradient = np.einsum("nrp,nr->p", d_params, residuals) + prior * params
        held = held_back(params, gradient, *_bounds(state.model))
        directions = np.where(held[:, None], 0.0, self.freedom.directions)
        d_shared = d_params @ directions
        if self.freedom.warp:
            back = state.rotations[self.views.view_of_row, :, 2]
            bent = np.einsum("nri,ni->nr", d_point, back)[..., None] * self.views.bows[:, None, :]
            d_shared = np.concatenate([d_shared, bent], -1)
            directions = np.pad(directions, ((0, 0), (0, 2)))
        normal = GroupedNormal.assemble(d_shared, d_local, residuals, self.views.groups)
        return normal.with_prior(directions.T @ (prior[:, None] * directions), directions.T @ (prior * params))

    def move(self, state: State, step: Array) -> State:
        camera, shared = self.freedom.directions.shape[1], self.freedom.count
        params = np.clip(state.model.params + self.freedom.directions @ step[:camera], *_bounds(state.model))
        poses = step[shared:].reshape(-1, 6)
        return State(
            state.model.with_params(params) if camera else state.model,
            so3.exp(poses[:, :3]) @ state.rotations,
            state.translations + poses[:, 3:],
            state.warp + step[camera:shared] if self.freedom.warp else state.warp,
        )

    def _prior(self, model: CameraModel) -> Array:
        # What is known of a parameter beforehand counts as residuals do, whose unit is sigma.
        return (self.spread.sigma / np.array([p.spread for p in model.parameters])) ** 2


def _bounds(model: CameraModel) -> tuple[Array, Array]:
    return np.array([p.low for p in model.parameters]), np.array([p.high for p in model.parameters])


def refine(
    state: State,
    views: BoardViews,
    *,
    freedom: Freedom | None = None,
    loss: str = "huber",
    spread: Spread | None = None,
    iterations: int = 100,
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
    iterations, tolerance, watch
        As in `minimise`.
    """
    freedom = Freedom.of(state.model) if freedom is None else freedom
    if spread is not None:
        problem = Bundle(views, freedom, spread)
        return minimise(problem, state, iterations=iterations, tolerance=tolerance, watch=watch)
    used = 0
    spread = Spread.of(state, views, loss)
    while True:
        problem = Bundle(views, freedom, spread)
        solution = minimise(problem, state, iterations=iterations, tolerance=tolerance, watch=watch)
        used += solution.iterations
        state, before = solution.state, spread
        spread = Spread.of(state, views, loss)
        if spread.like(before) or used >= 4 * iterations:
            return replace(solution, iterations=used)
