"""Fermat's principle: light goes where the length of its path does not change to first order.

A path from a lens to a point is given by where it meets each mirror: u = (a_1, b_1, a_2, b_2 ...), each pair a place in
the mirror's chart. Its length is L(u) = |P_1 - C| + |P_2 - P_1| + ... + |X - P_m| (of parallel rays the first is z of
P_1), and at a reflection dL/du = 0. The second derivatives need no more than the mirrors' curvature, however many there
are, and the implicit function theorem gives how the path moves with the point and with all parameters.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.optics.placed import Placed

Array = NDArray[np.float64]

# Newton's steps and damped ones together.
STEPS = 100
# The square of the gradient, a sine, that is no more than rounding.
ROUNDING = 1e-26
# What coordinates are rounded by, of their size.
ULP = 1e-15


class Path(NamedTuple):
    """Paths of N points over m mirrors.

    Attributes
    ----------
    corners
        The m reflection points, then the scene point, each (3, N) in the lens's frame.
    tangents
        Of each mirror (2, 3, N), how its reflection point moves with u.
    legs
        m + 1 unit vectors (3, N): from the lens to the first mirror, and so on to the point.
    lengths
        (N,) of each leg but the first of parallel rays, which is None.
    """

    corners: list[Array]
    tangents: list[Array]
    legs: list[Array]
    lengths: list[Array | None]
    gradient: Array
    hessian: Array

    def stretch(self) -> Array:
        """Give how far (2 m, N) the reflection points move with u."""
        return np.sqrt(np.concatenate([(tangent**2).sum(1) for tangent in self.tangents]))


def path(placed: Sequence[Placed], parallel: bool, u: Array, points: Array) -> Path:
    """Give the paths that meet the mirrors at u (2 m, N) on the way to points (3, N) of the lens's frame.

    Its gradient dL/du is (2 m, N), its Hessian (2 m, 2 m, N).
    """
    count, m = u.shape[1], len(placed)
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
    return Path(corners, tangents, legs, lengths, gradient, hessian)


def solve(hessian: Array, right: Array) -> Array:
    """Solve H x = r for (n, n, N) and (n, N) or (n, K, N); what is singular gives NaN or inf."""
    if len(hessian) == 2:
        (a, b), (c, d) = hessian
        return np.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / (a * d - b * c)
    # By halves: only the 2 x 2 of the last mirror's point, and of what it leaves to the others, is divided by.
    p, q, s = hessian[:-2, :-2], hessian[:-2, -2:], hessian[-2:, -2:]
    s_q = solve(s, hessian[-2:, :-2])  # (2, n - 2, N)
    s_r = solve(s, right[-2:])
    rest = right[:-2] - np.einsum("ijn,j...n->i...n", q, s_r)
    first = solve(p - np.einsum("ijn,jkn->ikn", q, s_q), rest)
    return np.concatenate([first, s_r - np.einsum("ijn,j...n->i...n", s_q, first)])


def stationary(
    placed: Sequence[Placed], parallel: bool, start: Array, points: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Find the paths of points (3, N) where dL/du = 0, by Newton's method from start (2 m, N).

    Where a step would not bring the gradient down it is damped as Levenberg and Marquardt do. What comes is u (2 m, N)
    and whether (N,) it is there to rounding.
    """
    u, done, rest = start.copy(), np.zeros(start.shape[1], np.bool_), np.arange(start.shape[1])
    best = _Linear.of(path(placed, parallel, u, points))
    damping = np.zeros(len(rest))
    for _ in range(STEPS):
        trial = u[:, rest] + best.step(damping)
        new = _Linear.of(path(placed, parallel, trial, points[:, rest]))
        better = new.square < best.square
        u[:, rest[better]] = trial[:, better]
        best = best.updated(new, better)
        # Rounding is all that is left where a step no longer helps.
        settled = (best.square < best.rounding) & (~better | (best.square < ROUNDING**1.2))
        done[rest[settled]] = True
        damping = np.where(better, damping / 16, np.maximum(8 * damping, 1e-4))
        damping[damping < 1e-7] = 0.0
        keep = ~settled & (damping < 1e8) & np.isfinite(best.square)
        if not keep.any():
            break
        rest, damping, best = rest[keep], damping[keep], best.kept(keep)
    return u, done


class _Linear(NamedTuple):
    """The gradient by length along the surface (2 m, N), its Jacobian (2 m, 2 m, N), and its square (N,).

    `rounding` (N,) is what of the square may be no more than that: close to a mirror, directions lose digits.
    """

    gradient: Array
    jacobian: Array
    square: Array
    rounding: Array

    @classmethod
    def of(cls, at: Path) -> "_Linear":
        stretch = at.stretch()
        gradient = at.gradient / stretch
        near, length = at.corners[-2], at.lengths[-1]
        assert length is not None  # only a parallel ray's first is
        rounding = ROUNDING + (ULP / length) ** 2 * (near * near).sum(0)
        return cls(gradient, at.hessian / stretch[:, None], (gradient**2).sum(0), rounding)

    def step(self, damping: Array) -> Array:
        step = -solve(self.jacobian, self.gradient)
        held = np.flatnonzero((damping > 0) | ~np.isfinite(step).all(0))
        if len(held):
            j, g = self.jacobian[:, :, held], self.gradient[:, held]
            normal = np.einsum("ian,ibn->abn", j, j)
            diagonal = np.arange(len(g))
            normal[diagonal, diagonal] *= 1 + np.maximum(damping[held], 1e-7)
            step[:, held] = -solve(normal, np.einsum("ian,in->an", j, g))
        return step

    def updated(self, new: "_Linear", where: NDArray[np.bool_]) -> "_Linear":
        return _Linear(*(np.where(where, n, old) for n, old in zip(new, self, strict=True)))

    def kept(self, keep: NDArray[np.bool_]) -> "_Linear":
        return _Linear(*(values[..., keep] for values in self))


def by_point(path: Path) -> Array:
    """Give how (N, 2, 3) a stationary path meets the first mirror elsewhere as the scene point moves.

    du/dX = -H^-1 d2L/du dX, where of the gradient only the last mirror's part knows X: -T_m^T (I - e e^T) / l.
    """
    tangent, leg = path.tangents[-1], path.legs[-1]
    right = np.zeros((len(path.gradient), 3, leg.shape[1]))
    right[-2:] = (tangent - (tangent * leg).sum(1)[:, None] * leg) / path.lengths[-1]
    return solve(path.hessian, right)[:2].transpose(2, 0, 1)


def by_parameters(placed: Sequence[Placed], parallel: bool, u: Array, points: Array, at: Path) -> Array:
    """Give how (N, 3, P) the first reflection point moves with the parameters of the mirrors and of their poses.

    With u held, both the gradient and the point are plain functions of them, which central differences follow to about
    1e-10 of their size; then du/dp = -H^-1 d2L/du dp.
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


def _step(placed: Placed, k: int, u: Array) -> float:
    """Give a step of a parameter that moves the mirror by a hundred thousandth of its distance, or of the points u."""
    rim = placed.mirror.rim
    if np.isfinite(rim):
        u = np.stack(placed.mirror.charted(*np.array([[0.7 * rim, 0.0, -0.5 * rim], [0.0, 0.7 * rim, -0.5 * rim]])))

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
