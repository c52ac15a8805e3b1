"""Uniform cubic B-splines of one and of two variables, and the distortion of the plane that is one of them.

The four control values around a place of a span, 0 <= f <= 1, have the weights (1 - f)^3/6, 2/3 - f^2 + f^3/2, the same
from the other end, and f^3/6 (de Boor, A practical guide to splines, 1978).
"""

import math
from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._elementwise import inverse_step, span_of
from omnisight.models._planar import Distorted
from omnisight.models._projector import Array, Partial

# Coefficients of f^0 ... f^3 on a span, from its four control values.
TO_POWERS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6


def weights(f: Any) -> Any:
    """Give what the four control values around a place of a span weigh."""
    e = 1.0 - f
    e2, f2 = e * e, f * f
    sixth, middle = 0.16666666666666666667, 0.66666666666666666667
    return sixth * e2 * e, middle + f2 * (0.5 * f - 1.0), middle + e2 * (0.5 * e - 1.0), sixth * f2 * f


def slopes(f: Any) -> Any:
    """Give the derivatives of `weights`, per span."""
    e = 1.0 - f
    return -0.5 * e * e, f * (1.5 * f - 2.0), e * (2.0 - 1.5 * e), 0.5 * f * f


def blend(values: Any, i: Any, w: Any) -> Any:
    """Give the sum of w (four) times values[i : i + 4]."""
    return w[0] * values[i] + w[1] * values[i + 1] + w[2] * values[i + 2] + w[3] * values[i + 3]


def blend_row(values: Any, j: Any, i: Any, w: Any) -> Any:
    """Give the sum of w (four) times values[j, i : i + 4]."""
    return w[0] * values[j, i] + w[1] * values[j, i + 1] + w[2] * values[j, i + 2] + w[3] * values[j, i + 3]


def blend_patch(values: Any, j: Any, i: Any, across: Any, down: Any) -> Any:
    """Give the sum of down (four) times across (four) times values[j : j + 4, i : i + 4]."""
    top = down[0] * blend_row(values, j, i, across) + down[1] * blend_row(values, j + 1, i, across)
    return top + down[2] * blend_row(values, j + 2, i, across) + down[3] * blend_row(values, j + 3, i, across)


FORMULAS = weights, slopes, blend, blend_row, blend_patch


def basis(place: Array, spans: int) -> Array:
    """Give what every control value weighs at places (N,) of a spline, (spans + 3, N)."""
    i, points = span_of(place, spans), np.arange(len(place))
    found = np.zeros((spans + 3, len(place)))
    for k, weight in enumerate(weights(place - i)):
        found[i + k, points] = weight
    return found


class BentPlane(Distorted):
    """x' = x + Du(x, y), y' = y + Dv(x, y) with two bicubic B-splines Du, Dv over the square from -extent to extent.

    `du` and `dv` hold n * n control values each, row by row.
    """

    extent: float
    du: tuple[float, ...]
    dv: tuple[float, ...]

    @cached_property
    def bend_u(self) -> Array:
        """The control values (n, n) of Du."""
        return np.array(self.du).reshape(2 * [math.isqrt(len(self.du))])

    @cached_property
    def bend_v(self) -> Array:
        """The control values (n, n) of Dv."""
        return np.array(self.dv).reshape(2 * [math.isqrt(len(self.dv))])

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        cells = len(m.bend_u) - 3
        per_px = 0.5 * cells / m.extent
        s, t = (x + m.extent) * per_px, (y + m.extent) * per_px
        i, j = span_of(s, cells), span_of(t, cells)
        across, down = weights(s - i), weights(t - j)
        return x + blend_patch(m.bend_u, j, i, across, down), y + blend_patch(m.bend_v, j, i, across, down)

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        cells = len(m.bend_u) - 3
        per_px = 0.5 * cells / m.extent
        s, t = (x + m.extent) * per_px, (y + m.extent) * per_px
        i, j = span_of(s, cells), span_of(t, cells)
        across, down = weights(s - i), weights(t - j)
        d_across, d_down = slopes(s - i), slopes(t - j)
        xx = 1.0 + per_px * blend_patch(m.bend_u, j, i, d_across, down)
        xy = per_px * blend_patch(m.bend_u, j, i, across, d_down)
        yx = per_px * blend_patch(m.bend_v, j, i, d_across, down)
        yy = 1.0 + per_px * blend_patch(m.bend_v, j, i, across, d_down)
        return xx, xy, yx, yy

    @staticmethod
    def first_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
        # A correction of some pixels needs fewer than a lens's distortion.
        p, q, _ = inverse_step(m, p, q, x, y)
        p, q, _ = inverse_step(m, p, q, x, y)
        return inverse_step(m, p, q, x, y)

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        cells = len(self.bend_u) - 3
        per_px = 0.5 * cells / self.extent
        across, down = basis((x + self.extent) * per_px, cells), basis((y + self.extent) * per_px, cells)
        patch = (down[:, None] * across).reshape(len(down) * len(across), len(x))
        # D depends on x/extent and y/extent alone.
        xx, xy, yx, yy = self.distort_jacobian(self, x, y)
        stretched = -((xx - 1.0) * x + xy * y) / self.extent, -(yx * x + (yy - 1.0) * y) / self.extent
        return {"du": (patch, 0.0), "dv": (0.0, patch), "extent": stretched}

    def derived(self) -> dict[str, Any]:
        return {**super().derived(), "bend_u": self.bend_u, "bend_v": self.bend_v}

    def plane_radius_max(self) -> float:
        # A spline is nowhere steeper than its control values: below 1 altogether, nothing folds.
        per_px = 0.5 * (len(self.bend_u) - 3) / self.extent
        rows = [sum(np.abs(np.diff(d, axis=k)).max() for k in (0, 1)) for d in (self.bend_u, self.bend_v)]
        return self.extent if per_px * max(rows) < 1.0 else self.radius_before_fold(self.extent)
