"""Fermat's principle: light takes a path of stationary length.

A path from the lens centre C over m mirrors to a point X is described by its reflection points: u = (a_1, b_1, a_2,
b_2, ...), each pair in the chart of its mirror. Its length is L(u) = |P_1 - C| + |P_2 - P_1| + ... + |X - P_m| (for a
telecentric lens the first term is the z of P_1). At the reflections dL/du = 0. The Hessian needs only the curvature of
each mirror. The implicit function theorem gives the derivatives of the path by the point and by all parameters.

All paths are solved at once: `stationary` is a Newton iteration over N independent problems with exact Hessians, which
the solvers of `omnisight.optim` (one problem, Gauss-Newton) cannot express.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.placed_mirror import PlacedMirror

Array = NDArray[np.float64]

# Newton steps and damped steps together; hard cases need some 30.
MAX_ITERATIONS = 100
# Squared gradient (sine of an angle) at the level of rounding errors.
GRADIENT_TOLERANCE_SQUARED = 1e-26
# Relative rounding error of coordinates.
COORDINATE_EPS = 1e-15


class Path(NamedTuple):
    """Paths of N points over m mirrors.

    Attributes
    ----------
    corners
        The m reflection points, then the scene point, each (3, N) in the lens frame.
    tangents
        For each mirror (2, 3, N): d reflection point / d u.
    legs
        m + 1 unit vectors (3, N): from the lens to the first mirror, and so on to the point.
    lengths
        (N,) of each leg; None for the first leg of parallel rays.
    gradient, hessian
        dL/du (2 m, N) and d2L/du2 (2 m, 2 m, N).
    """

    corners: list[Array]
    tangents: list[Array]
    legs: list[Array]
    lengths: list[Array | None]
    gradient: Array
    hessian: Array

    def chart_scale(self) -> Array:
        """Return the speeds (2 m, N) at which the reflection points move with u."""
        return np.sqrt(np.concatenate([(tangent**2).sum(1) for tangent in self.tangents]))


def path(placed: Sequence[PlacedMirror], parallel: bool, u: Array, points: Array) -> Path:
    """Return the paths with reflection points u (2 m, N) to scene points (3, N) of the lens frame."""
    corners: list[Array] = []
    tangents: list[Array] = []
    bends: list[Array] = []
    for i, p in enumerate(placed):
        r, t = p.lens_from_mirror.rotation, p.lens_from_mirror.translation
        point, slope, bend = p.mirror.surface(u[2 * i], u[2 * i + 1])
        corners.append(r @ point + t[:, None])
        tangents.append(r @ slope)
        bends.append(r @ bend)
    corners.append(points)
    legs = [np.array([[0.0], [0.0], [1.0]])]
    lengths: list[Array | None] = [None]
    if not parallel:
        lengths[0] = _length(corners[0])
        legs[0] = corners[0] / lengths[0]
    for start, end in pairwise(corners):
        difference = end - start
        length = _length(difference)
        lengths.append(length)
        legs.append(difference / length)
    return Path(corners, tangents, legs, lengths, *_derivatives(tangents, bends, legs, lengths))


def _derivatives(
    tangents: list[Array], bends: list[Array], legs: list[Array], lengths: list[Array | None]
) -> tuple[Array, Array]:
    """Return the gradient (2 m, N) and the block-tridiagonal Hessian (2 m, 2 m, N) of the path length."""
    count, m = tangents[0].shape[-1], len(tangents)
    gradient, hessian = np.empty((2 * m, count)), np.zeros((2 * m, 2 * m, count))
    for i, tangent in enumerate(tangents):
        before, after = legs[i], legs[i + 1]
        turn = before - after
        gradient[2 * i : 2 * i + 2] = (tangent * turn).sum(1)
        along = ((tangent * before).sum(1), (tangent * after).sum(1))
        for j, (k, l) in enumerate(((0, 0), (0, 1), (1, 1))):
            h = (turn * bends[i][j]).sum(0)
            inner = (tangent[k] * tangent[l]).sum(0)
            for length, c in zip((lengths[i], lengths[i + 1]), along, strict=True):
                if length is not None:
                    h = h + (inner - c[k] * c[l]) / length
            hessian[2 * i + k, 2 * i + l] = hessian[2 * i + l, 2 * i + k] = h
        if i + 1 < m:
            # d2L/du_i du_(i+1) = -T_i^T (I - e e^T) T_(i+1) / l
            ahead = (tangents[i + 1] * after).sum(1)
            for k in range(2):
                for l in range(2):
                    h = (along[1][k] * ahead[l] - (tangent[k] * tangents[i + 1][l]).sum(0)) / lengths[i + 1]
                    hessian[2 * i + k, 2 * i + 2 + l] = hessian[2 * i + 2 + l, 2 * i + k] = h
    return gradient, hessian


def solve(hessian: Array, right: Array) -> Array:
    """Solve H x = r for (n, n, N) and (n, N) or (n, K, N); singular systems give NaN or inf."""
    if len(hessian) == 2:
        (a, b), (c, d) = hessian
        return np.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)
    # Eliminate the last reflection point (Schur complement) to invert only 2 x 2 matrices.
    p, q, s = hessian[:-2, :-2], hessian[:-2, -2:], hessian[-2:, -2:]
    s_q = solve(s, hessian[-2:, :-2])  # (2, n - 2, N)
    s_r = solve(s, right[-2:])
    rest = right[:-2] - np.einsum("ijn,j...n->i...n", q, s_r)
    first = solve(p - np.einsum("ijn,jkn->ikn", q, s_q), rest)
    return np.concatenate([first, s_r - np.einsum("ijn,j...n->i...n", s_q, first)])


def stationary(
    placed: Sequence[PlacedMirror], parallel: bool, start: Array, points: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Find paths to points (3, N) with dL/du = 0, by damped Newton steps from start (2 m, N).

    A step that does not reduce the gradient is repeated with Levenberg-Marquardt damping.

    Returns
    -------
    u
        (2 m, N) reflection points.
    converged
        (N,), whether the gradient is zero up to rounding.
    """
    u, converged, active = start.copy(), np.zeros(start.shape[1], np.bool_), np.arange(start.shape[1])
    best = _Linearization.of(path(placed, parallel, u, points))
    damping = np.zeros(len(active))
    for _ in range(MAX_ITERATIONS):
        trial = u[:, active] + best.step(damping)
        new = _Linearization.of(path(placed, parallel, trial, points[:, active]))
        better = new.square < best.square
        u[:, active[better]] = trial[:, better]
        best = best.updated(new, better)
        # Converged if below the rounding level and either no longer improving or far below it.
        done = (best.square < best.rounding) & (~better | (best.square < GRADIENT_TOLERANCE_SQUARED**1.2))
        converged[active[done]] = True
        damping = np.where(better, damping / 16, np.maximum(8 * damping, 1e-4))
        damping[damping < 1e-7] = 0.0
        keep = ~done & (damping < 1e8) & np.isfinite(best.square)
        if not keep.any():
            break
        active, damping, best = active[keep], damping[keep], best.selected(keep)
    return u, converged


class _Linearization(NamedTuple):
    """Gradient per arc length on the surface (2 m, N), its Jacobian (2 m, 2 m, N) and squared norm (N,).

    `rounding` (N,) is the squared norm that rounding alone can cause; directions close to a mirror lose digits.
    """

    gradient: Array
    jacobian: Array
    square: Array
    rounding: Array

    @classmethod
    def of(cls, at: Path) -> "_Linearization":
        scale = at.chart_scale()
        gradient = at.gradient / scale
        near, length = at.corners[-2], at.lengths[-1]
        assert length is not None  # only the first leg of a parallel ray has no length
        rounding = GRADIENT_TOLERANCE_SQUARED + (COORDINATE_EPS / length) ** 2 * (near * near).sum(0)
        return cls(gradient, at.hessian / scale[:, None], (gradient**2).sum(0), rounding)

    def step(self, damping: Array) -> Array:
        """Return the Newton step (2 m, N), or the damped Gauss-Newton step of the gradient where damping > 0."""
        step = -solve(self.jacobian, self.gradient)
        damped = np.flatnonzero((damping > 0) | ~np.isfinite(step).all(0))
        if len(damped):
            j, g = self.jacobian[:, :, damped], self.gradient[:, damped]
            normal = np.einsum("ian,ibn->abn", j, j)
            diagonal = np.arange(len(g))
            normal[diagonal, diagonal] *= 1 + np.maximum(damping[damped], 1e-7)
            step[:, damped] = -solve(normal, np.einsum("ian,in->an", j, g))
        return step

    def updated(self, new: "_Linearization", where: NDArray[np.bool_]) -> "_Linearization":
        return _Linearization(*(np.where(where, n, old) for n, old in zip(new, self, strict=True)))

    def selected(self, keep: NDArray[np.bool_]) -> "_Linearization":
        return _Linearization(*(values[..., keep] for values in self))


def derivatives_by_point(path: Path) -> Array:
    """Return du_1/dX (N, 2, 3) of stationary paths: the first reflection point by the scene point.

    du/dX = -H^-1 d2L/du dX. Only the gradient of the last mirror depends on X: d2L/du_m dX = -T_m^T (I - e e^T) / l.
    """
    tangent, leg = path.tangents[-1], path.legs[-1]
    right = np.zeros((len(path.gradient), 3, leg.shape[1]))
    right[-2:] = (tangent - (tangent * leg).sum(1)[:, None] * leg) / path.lengths[-1]
    return solve(path.hessian, right)[:2].transpose(2, 0, 1)


def derivatives_by_parameters(
    placed: Sequence[PlacedMirror], parallel: bool, u: Array, points: Array, at: Path
) -> Array:
    """Return the derivatives (N, 3, P) of the first reflection point by the parameters of the mirrors and their poses.

    du/dp = -H^-1 d2L/du dp. At fixed u the gradient and the reflection point are explicit functions of p; central
    differences of them have a relative error of about 1e-10.
    """
    slopes, moves = [np.empty((0, *at.gradient.shape))], [np.empty((0, *at.corners[0].shape))]
    for i, p in enumerate(placed):
        for k, parameter in enumerate(p.parameters):
            if parameter.name in ("rim", "hole"):
                slopes.append(np.zeros((1, *at.gradient.shape)))
                moves.append(np.zeros((1, *at.corners[0].shape)))
                continue
            step = _step(p, k, u[2 * i : 2 * i + 2])
            both: list[Path] = []
            for h in (step, -step):
                params = p.params.copy()
                params[k] += h
                moved = [*placed[:i], p.with_params(params), *placed[i + 1 :]]
                both.append(path(moved, parallel, u, points))
            slopes.append((both[0].gradient - both[1].gradient)[None] / (2 * step))
            moves.append((both[0].corners[0] - both[1].corners[0])[None] / (2 * step))
    slope, move = np.concatenate(slopes), np.concatenate(moves)
    du = -solve(at.hessian, slope.transpose(1, 0, 2))[:2]
    return np.einsum("kin,kpn->nip", at.tangents[0], du) + move.transpose(2, 1, 0)


def _step(placed: PlacedMirror, k: int, u: Array) -> float:
    """Return a step of parameter k that moves points of the mirror by 1e-5 of their distance from the lens."""
    rim = placed.mirror.rim
    if np.isfinite(rim):
        u = np.stack(
            placed.mirror.chart_coordinates(*np.array([[0.7 * rim, 0.0, -0.5 * rim], [0.0, 0.7 * rim, -0.5 * rim]]))
        )

    def corners(params: Array) -> Array:
        p = placed.with_params(params)
        return p.lens_from_mirror @ p.mirror.surface(*u)[0].T

    params = placed.params.copy()
    now = corners(params)
    probe = 1e-6 * max(abs(params[k]), 1e-3)
    params[k] += probe
    moved = np.sqrt(((corners(params) - now) ** 2).sum(-1))
    size = np.sqrt((now**2).sum(-1))
    rate = np.nanmax(moved / size, initial=0.0) / probe
    return min(1e-5 / rate, 1.0) if rate > 0 else probe


def _length(vectors: Array) -> Array:
    return np.sqrt((vectors * vectors).sum(0))
