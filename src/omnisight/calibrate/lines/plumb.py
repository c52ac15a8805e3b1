"""The plumb line on the sphere: making the images of straight lines straight, for any camera model.

A straight line and the viewpoint span a plane, so the bearings of the line's pixels lie on one great circle: the
plumb-line principle (Brown, Close-range camera calibration, 1971) without a picture plane. What is minimised is the
distance in pixels between each pixel and the image of its line's great circle.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines.chains import Chains
from omnisight.models import CameraModel
from omnisight.optim.dense import held_back
from omnisight.optim.levenberg_marquardt import Solution, minimise
from omnisight.optim.loss import Huber
from omnisight.optim.schur import GroupedNormal

Array = NDArray[np.float64]

# What a pixel outside the model's domain costs, px: a large miss, but no reason to stop.
OUTSIDE = 50.0
HUBER_SIGMAS = 4.0
# The median of |x| of a unit Gaussian.
GAUSS_MEDIAN = 0.6744897501960817


@dataclass(frozen=True)
class Lines:
    """A camera model, and the plane of each line.

    Attributes
    ----------
    model
        The camera.
    normals
        (L, 3) unit normals of the planes through the viewpoint and the lines, in the camera frame.
    """

    model: CameraModel
    normals: Array

    def distances(self, chains: Chains) -> Array:
        """Give the distance (N,) of each pixel from the image of its line, px; `OUTSIDE` outside the domain."""
        return np.abs(_measure(self, chains).distance)

    def bearings(self, chains: Chains) -> Array:
        """Give the point of its line's great circle (N, 3) that is nearest to each pixel; NaN outside the domain."""
        return _feet(self, chains)

    def extents(self, chains: Chains) -> Array:
        """Give the angle (L,), radians, from one end of each line to the other, along its great circle."""
        feet = np.nan_to_num(_feet(self, chains))
        middle = chains.sums(feet)[chains.chain_of_row]
        ahead = np.cross(self.normals[chains.chain_of_row], middle)
        along = np.arctan2((feet * ahead).sum(1), (feet * middle).sum(1))
        return np.array([np.ptp(along[rows]) for rows in chains.groups])


@dataclass(frozen=True)
class _Measured:
    """Distances (N,) with their derivatives by the camera's parameters (N, P) and by the normal (N, 3)."""

    distance: Array
    d_params: Array
    d_normal: Array


@dataclass(frozen=True)
class PlumbLine:
    """The least-squares problem over `Lines`.

    Attributes
    ----------
    chains
        The pixels.
    loss
        What a distance costs.
    freedom
        How the camera's parameters move.
    """

    chains: Chains
    loss: Huber
    freedom: Freedom

    def cost(self, state: Lines) -> float:
        return self.loss.cost(state.distances(self.chains))

    def linearise(self, state: Lines) -> GroupedNormal:
        measured = _measure(state, self.chains)
        root = np.sqrt(self.loss.weight(np.abs(measured.distance)))[:, None]
        # A normal is moved in its tangent plane: two numbers.
        tangents = tangent_bases(state.normals)[self.chains.chain_of_row]
        d_local = root * np.einsum("ni,nij->nj", measured.d_normal, tangents)
        d_shared = root * (measured.d_params @ self.freedom.directions)
        residuals = root * measured.distance[:, None]
        d_shared[:, self._held(state.model, d_shared.T @ residuals[:, 0])] = 0.0
        return GroupedNormal.assemble(d_shared[:, None], d_local[:, None], residuals, self.chains.groups)

    def move(self, state: Lines, step: Array) -> Lines:
        count = self.freedom.directions.shape[1]
        model = state.model
        if count:
            low, high = _bounds(model)
            params = model.params + self.freedom.directions @ step[:count]
            model = model.with_params(np.clip(params, low, high))
        turn = np.einsum("lij,lj->li", tangent_bases(state.normals), step[count:].reshape(-1, 2))
        normals = state.normals + turn
        return Lines(model, normals / np.linalg.norm(normals, axis=1, keepdims=True))

    def _held(self, model: CameraModel, gradient: Array) -> NDArray[np.bool_]:
        """Say which directions run against a bound of the parameter that they move."""
        which = np.argmax(np.abs(self.freedom.directions), axis=0)
        low, high = _bounds(model)
        return held_back(model.params[which], gradient, low[which], high[which])


def refine_lines(
    state: Lines,
    chains: Chains,
    freedom: Freedom,
    *,
    loss: str = "huber",
    iterations: int = 60,
    tolerance: float = 1e-9,
    watch: Callable[[int, float], None] | None = None,
) -> Solution[Lines]:
    """Refine a camera and the planes of lines to the least (robust) distance in the picture.

    Parameters
    ----------
    state
        Where to begin.
    chains
        The images of lines, one for each normal.
    freedom
        How the camera's parameters move; none of them: only the planes do.
    loss
        "huber", its threshold four robust standard deviations, estimated twice; or "squared".
    iterations, tolerance, watch
        As in `minimise`.

    Raises
    ------
    ValueError
        If the loss is unknown.
    """
    if loss not in ("huber", "squared"):
        raise ValueError(f"unknown loss {loss!r}; there are huber, squared")
    solution = Solution(state, np.inf, False, 0, "nothing done")
    for _ in range(2 if loss == "huber" else 1):
        threshold = HUBER_SIGMAS * line_sigma(solution.state, chains) if loss == "huber" else np.inf
        problem = PlumbLine(chains, Huber(max(threshold, 1e-3)), freedom)
        solution = minimise(problem, solution.state, iterations=iterations, tolerance=tolerance, watch=watch)
    return solution


def line_sigma(state: Lines, chains: Chains) -> float:
    """Give the standard deviation (px) of pixels across their lines, from the median distance."""
    # Two numbers per line are fitted to its pixels.
    share = len(chains.pixels) / max(len(chains.pixels) - 2 * len(chains), 1)
    return float(np.median(state.distances(chains)) / GAUSS_MEDIAN * np.sqrt(share)) if len(chains) else 0.0


def lines_of(model: CameraModel, chains: Chains, *, steps: int = 2) -> Lines:
    """Fit the plane of each line to its pixels, the camera given.

    First the plane nearest to the bearings, then `steps` of Gauss-Newton on the distance in pixels. A line of whose
    pixels none lies in the model's domain gets the normal (0, 0, 1).
    """
    bearings, _ = model.unproject_numpy(chains.pixels)
    b = np.nan_to_num(bearings)
    scatter = chains.sums(b[:, :, None] * b[:, None, :])
    state = Lines(model, np.linalg.eigh(scatter)[1][:, :, 0] if len(chains) else np.zeros((0, 3)))
    held = PlumbLine(chains, Huber(), Freedom.none(model))
    for _ in range(steps):
        state = held.move(state, held.linearise(state).solve(1e-9))
    return state


def tangent_bases(normals: Array) -> Array:
    """Give two unit vectors across each normal (L, 3), as columns (L, 3, 2)."""
    flat = np.abs(normals[:, 2:]) < 0.7
    first = np.cross(normals, np.where(flat, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.asarray(np.cross(normals, first), np.float64)], -1)


def _feet(state: Lines, chains: Chains) -> Array:
    bearings, _ = state.model.unproject_numpy(chains.pixels)
    n = state.normals[chains.chain_of_row]
    feet = bearings - (n * bearings).sum(1, keepdims=True) * n
    with np.errstate(invalid="ignore", divide="ignore"):
        return feet / np.linalg.norm(feet, axis=1, keepdims=True)


def _measure(state: Lines, chains: Chains) -> _Measured:
    """Measure at the foot point: the point of the great circle nearest to the pixel's bearing.

    There the residual's derivative is exact, for the foot may slide along the curve at no cost. The derivative at the
    pixel itself, n . b over its gradient with the gradient held, would be biased: noise would shrink the picture.
    """
    n = state.normals[chains.chain_of_row]
    foot = _feet(state, chains)
    pixels, valid, d_point, d_params = state.model.project_with_jacobians(foot)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = np.einsum("nij,nj->ni", d_point, np.cross(n, foot))
        across = np.stack([-along[:, 1], along[:, 0]], -1) / np.linalg.norm(along, axis=1, keepdims=True)
        distance = ((pixels - chains.pixels) * across).sum(1)
        d_params = np.einsum("ni,nip->np", across, d_params)
        # A turn dn of the normal moves the foot by -(foot . dn) n.
        d_normal = -np.einsum("ni,nij,nj->n", across, d_point, n)[:, None] * foot
    outside = ~valid | ~np.isfinite(d_params).all(1) | ~np.isfinite(d_normal).all(1)
    distance = np.where(outside, OUTSIDE, distance)
    d_params[outside], d_normal[outside] = 0.0, 0.0
    return _Measured(distance, d_params, d_normal)


def _bounds(model: CameraModel) -> tuple[Array, Array]:
    return np.array([p.low for p in model.parameters]), np.array([p.high for p in model.parameters])
