"""Plumb-line bundle adjustment on the sphere: estimate the camera for which images of straight lines are straight.

A straight line and the viewpoint span a plane, so the bearings of the line's pixels lie on one great circle: the
plumb-line principle (Brown, Close-range camera calibration, 1971) without an image plane. The residual is the distance
in pixels between a pixel and the image of its line's great circle.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.display import Displayed
from omnisight.models import CameraModel
from omnisight.optim.levenberg_marquardt import Solution, blocked_by_bounds, minimize
from omnisight.optim.loss import Huber
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]

# Residual of a pixel outside the model's domain: large, but finite: the optimisation can continue.
OUT_OF_DOMAIN_PX = 50.0
# Threshold of the Huber loss in robust standard deviations, and its lower bound for exact data.
OUTLIER_SIGMA, MIN_HUBER_PX = 4.0, 1e-3
# Median of |x| for a standard normal variable.
NORMAL_MEDIAN = 0.6744897501960817


@dataclass(frozen=True)
class PlumbLineState(Displayed):
    """A camera model and the plane of each line.

    Attributes
    ----------
    model
        The camera model.
    normals
        (L, 3) unit normals of the planes through the viewpoint and the lines, in the camera frame.
    """

    model: CameraModel
    normals: Array

    def distances(self, chains: PixelChains) -> Array:
        """Return the distance (N,) of each pixel from its line, px; `OUT_OF_DOMAIN_PX` outside the model's domain."""
        return np.abs(_evaluate_residuals(self, chains).distance)

    def foot_points(self, chains: PixelChains) -> Array:
        """Return the point (N, 3) of the line's great circle nearest to each bearing; NaN outside the domain."""
        bearings, _ = self.model.unproject_numpy(chains.pixels)
        n = self.normals[chains.chain_of_pixel]
        feet = bearings - np.einsum("ni,ni->n", n, bearings)[:, None] * n
        with np.errstate(invalid="ignore", divide="ignore"):
            return feet / np.sqrt(np.einsum("ni,ni->n", feet, feet))[:, None]

    def angular_extents(self, chains: PixelChains) -> Array:
        """Return the angle (L,), radians, between the ends of each line along its great circle."""
        feet = np.nan_to_num(self.foot_points(chains))
        middle = chains.sum_by_chain(feet)[chains.chain_of_pixel]
        ahead = np.cross(self.normals[chains.chain_of_pixel], middle)
        angle = np.arctan2((feet * ahead).sum(1), (feet * middle).sum(1))
        return np.array([np.ptp(angle[rows]) for rows in chains.groups])


@dataclass(frozen=True)
class _Residuals:
    """Signed distances (N,) with their derivatives by the parameters (N, P) and by the normal (N, 3)."""

    distance: Array
    d_params: Array
    d_normal: Array


@dataclass(frozen=True)
class PlumbLineProblem:
    """The robust least-squares problem over `PlumbLineState`.

    Attributes
    ----------
    chains
        The pixels of each line.
    loss
        The robust loss of a distance.
    free_parameters
        The estimated combinations of camera parameters.
    """

    chains: PixelChains
    loss: Huber
    free_parameters: FreeParameters

    def cost(self, state: PlumbLineState) -> float:
        return self.loss.cost(state.distances(self.chains))

    def linearize(self, state: PlumbLineState) -> GroupedNormal:
        residuals = _evaluate_residuals(state, self.chains)
        root_weight = np.sqrt(self.loss.weight(np.abs(residuals.distance)))[:, None]
        tangents = tangent_bases(state.normals)[self.chains.chain_of_pixel]
        d_normal = root_weight * np.einsum("ni,nij->nj", residuals.d_normal, tangents)
        d_camera = root_weight * (residuals.d_params @ self.free_parameters.directions)
        weighted = root_weight * residuals.distance[:, None]
        d_camera[:, self._is_held_at_bound(state.model, d_camera.T @ weighted[:, 0])] = 0.0
        return GroupedNormal.assemble(d_camera[:, None], d_normal[:, None], weighted, self.chains.groups)

    def move(self, state: PlumbLineState, step: Array) -> PlumbLineState:
        count = self.free_parameters.directions.shape[1]
        model = state.model
        if count:
            low, high = _bounds(model)
            params = model.params + self.free_parameters.directions @ step[:count]
            model = model.with_params(np.clip(params, low, high))
        shift = np.einsum("lij,lj->li", tangent_bases(state.normals), step[count:].reshape(-1, 2))
        normals = state.normals + shift
        return PlumbLineState(model, normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def _is_held_at_bound(self, model: CameraModel, gradient: Array) -> NDArray[np.bool_]:
        """Return which directions would push the parameter that they move across its bound."""
        which = np.argmax(np.abs(self.free_parameters.directions), axis=0)
        low, high = _bounds(model)
        return blocked_by_bounds(model.params[which], gradient, low[which], high[which])


def refine_plumb_lines(
    state: PlumbLineState,
    chains: PixelChains,
    free_parameters: FreeParameters,
    *,
    loss: str = "huber",
    iterations: int = 60,
    tolerance: float = 1e-9,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[PlumbLineState]:
    """Refine a camera and the planes of its lines by minimising the (robust) distances in the image.

    Parameters
    ----------
    state
        Initial state.
    chains
        Images of the lines, one for each normal.
    free_parameters
        Estimated combinations of camera parameters; with none of them only the planes are refined.
    loss
        "huber" with a threshold of four robust standard deviations, estimated twice; or "squared".
    iterations, tolerance, watch
        As in `minimize`.

    Raises
    ------
    ValueError
        If the loss is unknown.
    """
    if loss not in ("huber", "squared"):
        raise ValueError(f"unknown loss {loss!r}; choose huber or squared")
    solution = Solution(state, np.inf, False, 0, "not started")
    for _ in range(2 if loss == "huber" else 1):
        huber = huber_loss(line_sigma(solution.state, chains)) if loss == "huber" else Huber()
        problem = PlumbLineProblem(chains, huber, free_parameters)
        solution = minimize(problem, solution.state, iterations=iterations, tolerance=tolerance, watch=watch)
    return solution


def huber_loss(sigma: float) -> Huber:
    """Return the Huber loss for residuals with the given standard deviation, px."""
    return Huber(max(OUTLIER_SIGMA * sigma, MIN_HUBER_PX))


def line_sigma(state: PlumbLineState, chains: PixelChains) -> float:
    """Estimate the standard deviation (px) of pixels across their lines from the median distance."""
    # Two parameters per line are fitted to its pixels.
    dof_factor = len(chains.pixels) / max(len(chains.pixels) - 2 * len(chains), 1)
    return float(np.median(state.distances(chains)) / NORMAL_MEDIAN * np.sqrt(dof_factor)) if len(chains) else 0.0


def fit_line_planes(model: CameraModel, chains: PixelChains, *, refinement_steps: int = 2) -> PlumbLineState:
    """Fit the plane of each line to its pixels for a fixed camera.

    The initial plane minimises the squared sines of the bearings; `refinement_steps` Gauss-Newton steps then minimize
    the distance in pixels. A line without any pixel in the model's domain gets the normal (0, 0, 1).
    """
    bearings = np.nan_to_num(model.unproject_numpy(chains.pixels)[0])
    scatter = chains.sum_by_chain(bearings[:, :, None] * bearings[:, None, :])
    state = PlumbLineState(model, np.linalg.eigh(scatter)[1][:, :, 0] if len(chains) else np.zeros((0, 3)))
    problem = PlumbLineProblem(chains, Huber(), FreeParameters.none(model))
    for _ in range(refinement_steps):
        state = problem.move(state, problem.linearize(state).solve(1e-9))
    return state


def tangent_bases(normals: Array) -> Array:
    """Return two unit vectors perpendicular to each normal (L, 3), as columns (L, 3, 2)."""
    is_flat = np.abs(normals[:, 2:]) < 0.7
    first = np.cross(normals, np.where(is_flat, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.asarray(np.cross(normals, first), np.float64)], -1)


def _evaluate_residuals(state: PlumbLineState, chains: PixelChains) -> _Residuals:
    """Evaluate the residuals at the foot points.

    There the derivative is exact, because the foot point moves along the curve without changing the distance. The
    linearized distance at the pixel itself is biased: noise would shrink the focal length.
    """
    n = state.normals[chains.chain_of_pixel]
    foot = state.foot_points(chains)
    pixels, valid, d_point, d_params = state.model.project_with_jacobians(foot)
    # Derivatives are contiguous over the pixels, the last axis of their transposes.
    by_point, by_params = d_point.T, d_params.T
    with np.errstate(invalid="ignore", divide="ignore"):
        tangent = (by_point * _cross(n.T, foot.T)[:, None]).sum(0)
        across = np.stack([-tangent[1], tangent[0]]) / np.hypot(*tangent)
        distance = ((pixels - chains.pixels).T * across).sum(0)
        d_params = (by_params * across).sum(1).T
        # A change dn of the normal moves the foot point by -(foot . dn) n.
        d_normal = -((by_point * n.T[:, None]).sum(0) * across).sum(0)[:, None] * foot
    outside = ~valid | ~np.isfinite(d_params).all(1) | ~np.isfinite(d_normal).all(1)
    distance = np.where(outside, OUT_OF_DOMAIN_PX, distance)
    d_params[outside], d_normal[outside] = 0.0, 0.0
    return _Residuals(distance, d_params, d_normal)


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products (3, N) of vectors (3, N), in a third of the time of `np.cross`."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _bounds(model: CameraModel) -> tuple[Array, Array]:
    return np.array([p.low for p in model.parameters]), np.array([p.high for p in model.parameters])
