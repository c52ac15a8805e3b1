"""A correction of the plane by two bicubic B-splines."""

import math
from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._bspline import basis, blend_patch, slopes, weights
from omnisight.models._elementwise import span_index, table
from omnisight.models._planar_distortion import PlanarDistortion, newton_step
from omnisight.models._projector import Array, Partial


class SplineDistortion(PlanarDistortion):
    """x' = x + Du(x, y), y' = y + Dv(x, y) with two bicubic B-splines Du, Dv over the square from -extent to extent.

    `du` and `dv` hold n * n control values each, row by row.
    """

    extent: float
    du: tuple[float, ...]
    dv: tuple[float, ...]

    @cached_property
    def control_u(self) -> Array:
        """The control values (n, n) of Du."""
        return square(self.du)

    @cached_property
    def control_v(self) -> Array:
        """The control values (n, n) of Dv."""
        return square(self.dv)

    @staticmethod
    def distort(m: Any, x: Any, y: Any) -> Any:
        cells = len(m.control_u) - 3
        per_px = 0.5 * cells / m.extent
        s, t = (x + m.extent) * per_px, (y + m.extent) * per_px
        i, j = span_index(s, cells), span_index(t, cells)
        across, down = weights(s - i), weights(t - j)
        return x + blend_patch(m.control_u, j, i, across, down), y + blend_patch(m.control_v, j, i, across, down)

    @staticmethod
    def distort_jacobian(m: Any, x: Any, y: Any) -> Any:
        cells = len(m.control_u) - 3
        per_px = 0.5 * cells / m.extent
        s, t = (x + m.extent) * per_px, (y + m.extent) * per_px
        i, j = span_index(s, cells), span_index(t, cells)
        across, down = weights(s - i), weights(t - j)
        d_across, d_down = slopes(s - i), slopes(t - j)
        xx = 1.0 + per_px * blend_patch(m.control_u, j, i, d_across, down)
        xy = per_px * blend_patch(m.control_u, j, i, across, d_down)
        yx = per_px * blend_patch(m.control_v, j, i, d_across, down)
        yy = 1.0 + per_px * blend_patch(m.control_v, j, i, across, d_down)
        return xx, xy, yx, yy

    @staticmethod
    def first_newton_steps(m: Any, p: Any, q: Any, x: Any, y: Any) -> Any:
        # A correction of a few pixels needs fewer steps than the distortion of a lens.
        p, q, _ = newton_step(m, p, q, x, y)
        return p, q

    def distort_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        cells = len(self.control_u) - 3
        per_px = 0.5 * cells / self.extent
        across, down = basis((x + self.extent) * per_px, cells), basis((y + self.extent) * per_px, cells)
        patch = (down[:, None] * across).reshape(len(down) * len(across), len(x))
        # D depends on x/extent and y/extent alone.
        xx, xy, yx, yy = self.distort_jacobian(self, x, y)
        stretched = -((xx - 1.0) * x + xy * y) / self.extent, -(yx * x + (yy - 1.0) * y) / self.extent
        return {"du": (patch, 0.0), "dv": (0.0, patch), "extent": stretched}

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        return {**super().derived(m), "control_u": square(m.du), "control_v": square(m.dv)}

    def plane_radius_max(self) -> float:
        # The slope of a spline is bounded by that of its control values; below 1 in total, nothing folds.
        per_px = 0.5 * (len(self.control_u) - 3) / self.extent
        rows = [sum(np.abs(np.diff(d, axis=k)).max() for k in (0, 1)) for d in (self.control_u, self.control_v)]
        return self.extent if per_px * max(rows) < 1.0 else self.radius_without_fold(self.extent)


def square(values: Any) -> Any:
    """Return n * n values as an array (n, n)."""
    side = math.isqrt(len(values))
    return table(values).reshape(side, side)
