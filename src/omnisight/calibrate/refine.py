"""Refining a camera and the poses of its boards together (bundle adjustment)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.views import BoardViews
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.dense import held_back
from omnisight.optim.levenberg_marquardt import Solution, minimise
from omnisight.optim.loss import Huber, robust_sigma
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]

HUBER_SIGMAS = 5.0
# What a corner outside the model's domain costs, px: a large miss, but no reason to stop.
OUTSIDE = 100.0
# What corners are off by in any case, px: a covariance of zero must not outweigh all others.
LEAST_SPREAD = 1e-4


@dataclass(frozen=True)
class State:
    """A camera model and where each board stands.

    Attributes
    ----------
    model
        The camera.
    rotations, translations
        cam_from_board (V, 3, 3) and (V, 3).
    """

    model: CameraModel
    rotations: Array
    translations: Array

    def points(self, views: BoardViews) -> tuple[Array, Array]:
        """Give the corners in the camera frame (N, 3), and only turned into it (N, 3)."""
        turned = np.empty_like(views.points)
        for rotation, rows in zip(self.rotations, views.groups, strict=True):
            turned[rows] = views.points[rows] @ rotation.T
        return turned + self.translations[views.view_of_row], turned

    def residuals(self, views: BoardViews) -> Array:
        """Give projected minus seen pixels (N, 2), NaN where a corner lies outside the model's domain."""
        pixels, _ = self.model.project_numpy(self.points(views)[0])
        return pixels - views.pixels

    def lengths(self, views: BoardViews, roots: Array | None = None) -> Array:
        """Give the length (px) of each corner's residual (N,), times `roots` (N, 2, 2) if there are any.

        `OUTSIDE` outside the model's domain.
        """
        residuals = self.residuals(views)
        if roots is not None:
            residuals = np.einsum("nij,nj->ni", roots, residuals)
        length = np.linalg.norm(residuals, axis=1)
        return np.where(np.isfinite(length), length, OUTSIDE)


@dataclass(frozen=True)
class Bundle:
    """The least-squares problem over `State`.

    Attributes
    ----------
    views
        The corners.
    loss
        What a residual of a certain length costs.
    free
        (P,) which of the camera's parameters move.
    roots
        (N, 2, 2) what each residual is multiplied with, from `weight_roots`.
    """

    views: BoardViews
    loss: Huber
    free: NDArray[np.bool_]
    roots: Array

    def cost(self, state: State) -> float:
        return self.loss.cost(state.lengths(self.views, self.roots))

    def linearise(self, state: State) -> GroupedNormal:
        points, turned = state.points(self.views)
        pixels, valid, d_point, d_params = state.model.project_with_jacobians(points)
        residuals = pixels - self.views.pixels
        outside = ~valid | ~np.isfinite(d_params).all((1, 2))
        residuals[outside], d_point[outside], d_params[outside] = 0.0, 0.0, 0.0
        residuals = np.einsum("nij,nj->ni", self.roots, residuals)
        root = np.sqrt(self.loss.weight(np.linalg.norm(residuals, axis=1)))[:, None]
        weight = self.roots * root[..., None]
        d_point = weight @ d_point
        # x_c = exp(w) R x + t + v:  dx_c/dw = -[R x]_x, and a row vector times -[a]_x is a x row.
        d_local = np.concatenate([np.cross(turned[:, None, :], d_point), d_point], -1)
        d_shared, residuals = weight @ d_params[..., self.free], residuals * root
        low, high = self._bounds(state.model)
        gradient = np.einsum("nrp,nr->p", d_shared, residuals)
        d_shared[..., held_back(state.model.params[self.free], gradient, low[self.free], high[self.free])] = 0.0
        return GroupedNormal.assemble(d_shared, d_local, residuals, self.views.groups)

    def move(self, state: State, step: Array) -> State:
        count = int(self.free.sum())
        params = state.model.params.copy()
        params[self.free] += step[:count]
        low, high = self._bounds(state.model)
        poses = step[count:].reshape(-1, 6)
        return State(
            state.model.with_params(np.clip(params, low, high)) if count else state.model,
            so3.exp(poses[:, :3]) @ state.rotations,
            state.translations + poses[:, 3:],
        )

    @staticmethod
    def _bounds(model: CameraModel) -> tuple[Array, Array]:
        return np.array([p.low for p in model.parameters]), np.array([p.high for p in model.parameters])


def free_params(model: CameraModel) -> NDArray[np.bool_]:
    """Say which parameters a calibration estimates unless told otherwise (P,)."""
    return np.array([p.free for p in model.parameters])


def refine(
    state: State,
    views: BoardViews,
    *,
    free: NDArray[np.bool_] | None = None,
    loss: str = "huber",
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
    free
        Which of the camera's parameters move (P,); `free_params` unless told otherwise. None of them: only the poses
        move.
    loss
        "huber", its threshold five robust standard deviations, estimated anew until it settles; or "squared".
    iterations, tolerance, watch
        As in `minimise`.
    """
    free = free_params(state.model) if free is None else free
    if loss == "squared":
        equal = np.broadcast_to(np.eye(2), (len(views.pixels), 2, 2))
        problem = Bundle(views, Huber(), free, equal)
        return minimise(problem, state, iterations=iterations, tolerance=tolerance, watch=watch)
    if loss != "huber":
        raise ValueError(f"loss must be 'huber' or 'squared', got {loss!r}")
    used = 0
    roots = weight_roots(state, views)
    threshold = robust_threshold(state, views, roots)
    while True:
        problem = Bundle(views, Huber(threshold), free, roots)
        solution = minimise(problem, state, iterations=iterations, tolerance=tolerance, watch=watch)
        used += solution.iterations
        state, before = solution.state, threshold
        roots = weight_roots(state, views)
        threshold = robust_threshold(state, views, roots)
        if abs(threshold - before) <= 0.02 * before or used >= 4 * iterations:
            return replace(solution, iterations=used)


def robust_threshold(state: State, views: BoardViews, roots: Array) -> float:
    """Give the length (px) of a weighted residual past which a corner counts as doubtful."""
    return max(HUBER_SIGMAS * robust_sigma(state.lengths(views, roots)), 1e-6)


def weight_roots(state: State, views: BoardViews) -> Array:
    """Give matrices (N, 2, 2) that make residuals alike: times them, all have the same spread, in px.

    A residual's covariance is the corner's own C plus t^2 I, what model, print and light add to every corner alike.
    t is such that the median of r^T (C + t^2 I)^-1 r is that of two normal variables, 2 ln 2. Where no covariance is
    known the matrices are I.
    """
    own = np.trace(views.covariance, axis1=1, axis2=2) / 2
    if not own.any():  # nor if there are no corners
        return np.broadcast_to(np.eye(2), (len(own), 2, 2))
    squares = state.lengths(views) ** 2

    def excess(shared: float) -> float:
        return float(np.median(squares / (own + shared))) - 2 * np.log(2)

    low, high = LEAST_SPREAD**2, float(squares.max()) + 1e-6
    if excess(low) <= 0:
        high = low
    while high > 1.001 * low:  # by bisection of the exponent
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    covariance = views.covariance + high * np.eye(2)
    scale = np.median(own) + high
    return np.swapaxes(np.linalg.cholesky(np.linalg.inv(covariance) * scale), 1, 2)
