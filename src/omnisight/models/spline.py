"""The generic camera: splines along the radius and over the image."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from omnisight.models._angle_polynomial import MAX_SQUARED_STEP
from omnisight.models._bspline import TO_POWERS, basis, blend, slopes, weights
from omnisight.models._camera_model import VariantFit
from omnisight.models._elementwise import (
    any_of,
    atan2,
    elementwise,
    rounding,
    sine_cosine,
    span_index,
    sqrt,
    table,
    where,
    without_gradient,
)
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._profile_camera import ProfileCamera, derivative_by_cosine
from omnisight.models._projector import Array, Partial
from omnisight.models._spline_distortion import SplineDistortion
from omnisight.models.equidistant import Equidistant

# Default spans of the radius, and cells along each side of the correction.
SPANS, CELLS = 16, 5
# Spans of the radius in a calibration, and cells along each side with fewer than that many corners, and with more.
CALIBRATED_SPANS, MANY_CORNERS, MIN_CALIBRATED_CELLS, MAX_CALIBRATED_CELLS = 10, 800, 3, 5
# Limits for files: spans of the radius, control values along each side of the correction.
MAX_SPANS, MAX_SIDE = 200, 100
# Cells of the table that starts the inversion of the profile.
START_CELLS = 256
# Weight of the second differences of the profile: it decides only where no pixel does.
SMOOTHING = 1e-3


@elementwise
def bracketed_newton_step(m: Any, theta: Any, low: Any, high: Any, r: Any) -> Any:
    """Return theta after a Newton step towards r(theta) = r, bracket and step; bisect outside the bracket."""
    theta = where((theta >= low) & (theta <= high), theta, 0.5 * (low + high))
    spans = len(m.controls) - 3
    position = theta * (spans / m.reach)
    i = span_index(position, spans)
    mean_slope = blend(m.controls, i, weights(position - i))
    slope = mean_slope + position * blend(m.controls, i, slopes(position - i))
    value = r - theta * mean_slope  # positive before the root
    step = value / slope
    return theta + step, where(value > 0.0, theta, low), where(value > 0.0, high, theta), step


def even_controls(r: Any) -> Any:
    """Return the control values of an even spline: the one before the axis is the one after it."""
    return table(r)[[1, *range(len(r))]]


class SplineProfile(ProfileCamera):
    """r(theta) = theta S(theta), S an even uniform cubic B-spline on [0, reach]: r is smooth on the axis."""

    reach: float
    r: tuple[float, ...]

    @cached_property
    def controls(self) -> Array:
        """The control values of S, from the one before the axis: S is even."""
        return even_controls(self.r)

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        theta = atan2(s, c)
        position = theta * ((len(m.controls) - 3) / m.reach)
        i = span_index(position, len(m.controls) - 3)
        mean_slope = blend(m.controls, i, weights(position - i))
        return where(s > 1e-9, mean_slope * theta / where(s > 1e-9, s, 1.0), mean_slope)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        # theta(r) behaves like a square root at a fold, so theta/r is smooth in w and is tabulated over it.
        w = 1.0 - (r * m.over_last) ** 2
        w = sqrt(where(w > 0.0, w, 0.0))
        position = w * (len(m.start) - 1)
        i = span_index(position, len(m.start) - 1)
        theta = r * (m.start[i] + (position - i) * (m.start[i + 1] - m.start[i]))
        low, high = 0.0 * theta, m.theta_last + 0.0 * theta
        # The error is the square of the last step over w, which vanishes at the fold. Beyond the rim no angle exists.
        largest = MAX_SQUARED_STEP * rounding(r) * w
        if max_iterations is not None:
            for _ in range(max_iterations):
                theta, low, high, step = bracketed_newton_step(m, theta, low, high, r)
                if not any_of((step * step >= largest) & (r <= m.r_last)):
                    break
        # Unrolled: the compiled loop over the points then vectorizes.
        theta, low, high, step = bracketed_newton_step(m, without_gradient(theta), low, high, r)
        theta, low, high, step = bracketed_newton_step(m, theta, low, high, r)
        theta = where(theta < m.theta_last, theta, m.theta_last)
        s, c = sine_cosine(where(theta > 0.0, theta, 0.0))
        converged = (step * step < largest) | (r > m.r_last)
        return where(converged, where(r > 1e-9, s / where(r > 1e-9, r, 1.0), m.start[len(m.start) - 1]), np.inf), c

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        return {**super().derived(m), "controls": even_controls(m.r)}

    def unprojection_constants(self) -> dict[str, Any]:
        limit = min(self.reach, self.fold, np.pi)
        theta = limit * np.sin(np.linspace(0, np.pi / 2, 4 * START_CELLS + 1))  # denser towards the fold
        with np.errstate(all="ignore"):
            mean_slope = self._mean_slope(theta)
            r = theta * mean_slope
            w = np.sqrt(np.maximum(1 - (r / r[-1]) ** 2, 0))
            start = np.interp(np.linspace(0, 1, START_CELLS + 1), w[::-1], 1 / mean_slope[::-1])
            over_last = float(1 / r[-1])
        inverse = {
            "start": start,
            "over_last": over_last,
            # Slightly larger than the last angle, because the edge itself is valid.
            "theta_last": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return {**super().unprojection_constants(), **inverse}

    def _mean_slope(self, theta: Array) -> Array:
        position = theta * ((len(self.controls) - 3) / self.reach)
        i = span_index(position, len(self.controls) - 3)
        return blend(self.controls, i, weights(position - i))

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops increasing; inf if it increases up to the last knot."""
        spans = len(self.controls) - 3
        around = np.lib.stride_tricks.sliding_window_view(self.controls, 4)
        p0, p1, p2, p3 = TO_POWERS @ around.T
        # dr/dtheta = S + (k + f) dS/df on span k, as a cubic in f.
        k = np.arange(spans)
        cubic = np.stack([p0 + k * p1, 2 * (p1 + k * p2), 3 * (p2 + k * p3), 4 * p3], -1)
        # A cubic is bounded below by its Bezier control points.
        bezier = cubic @ np.array([[1, 1, 1, 1], [0, 1 / 3, 2 / 3, 1], [0, 0, 1 / 3, 1], [0, 0, 0, 1]])
        for span in np.flatnonzero(bezier.min(axis=1) <= 0):
            f = 0.0 if cubic[span, 0] <= 0 else first_positive_root([float(c) for c in cubic[span]])
            if f <= 1:
                return float((span + f) * self.reach / spans)
        return np.inf

    @property
    def theta_max(self) -> float:
        return min(self.reach, self.fold_angle)

    @property
    def fold_angle(self) -> float:
        # The last knot is near the last corner, where the image need not fold.
        return min(self.fold * (1 - FOLD_MARGIN), np.pi)

    def radius_max(self) -> float:
        limit = self.theta_max
        return float(limit * self._mean_slope(np.array([limit]))[0])

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        theta = atan2(s, c)
        spans = len(self.controls) - 3
        position = theta * (spans / self.reach)
        i = span_index(position, spans)
        mean_slope = blend(self.controls, i, weights(position - i))
        theta_slope = position * blend(self.controls, i, slopes(position - i))  # theta dS/dtheta
        # S = S0 + S2 theta^2 + ...:  dg/dc = -(2 S2 + S0/3) on the axis.
        at_axis = -2 * (spans / self.reach) ** 2 * (self.r[1] - self.r[0]) - (2 * self.r[0] + self.r[1]) / 9
        dg_dc = derivative_by_cosine(s, c, g, slope=mean_slope + theta_slope, at_axis=at_axis)
        over_sine = where(s > 1e-9, theta / where(s > 1e-9, s, 1.0), 1.0)
        weight = basis(position, spans)
        weight[2] += weight[0]  # the control value before the axis is the one after it
        return dg_dc, {"r": over_sine * weight[1:], "reach": -over_sine * theta_slope / self.reach}


@dataclass(frozen=True)
class Spline(SplineDistortion, SplineProfile):
    """Generic spline camera: any smooth profile, and any small smooth correction of the image.

    r = theta S(theta) with S an even cubic B-spline of evenly spaced knots from 0 to reach, in px: there are as many
    spans as values in r, less two. Then on the plane (x, y) = r (cos phi, sin phi)
    u = x + Du(x, y) + cx
    v = y + Dv(x, y) + cy
    with bicubic B-splines Du and Dv over the square -extent <= x, y <= extent, n * n control values each, row by row.
    Stretch, skew and tangential distortion are inside the correction.

    The baseline for the models with few parameters: its residuals are not caused by the model. Valid up to reach, or
    where r stops increasing, and within the circle inscribed in the square. Similar to Schoeps, Larsson,
    Pollefeys and Sattler, Why having 10,000 parameters in your camera model is better than twelve, CVPR 2020, with a
    profile of its own, which keeps the correction small.
    """

    unrolled_steps: ClassVar[int] = 2  # from a table, and with a correction of a few pixels
    auto_max_theta: ClassVar[float] = 0.0

    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    reach: float = parameter("angle of the last knot of S, radians", low=1e-3, high=np.pi, free=False)
    extent: float = parameter("half the side of the square of the correction", unit="px", low=1e-3, free=False)
    r: tuple[float, ...] = parameter("control value of S, px per radian", unit="px", low=1e-3)
    du: tuple[float, ...] = parameter("control value of the correction of u", unit="px", prior_sigma=1.0)
    dv: tuple[float, ...] = parameter("control value of the correction of v", unit="px", prior_sigma=1.0)

    def __post_init__(self) -> None:
        """Check the numbers of control values."""
        if not (self.reach > 0 and self.extent > 0):
            raise ValueError(f"spline needs reach and extent above 0, got {self.reach:g} and {self.extent:g}")
        if not 3 <= len(self.r) <= MAX_SPANS + 2:
            raise ValueError(f"spline needs 3 to {MAX_SPANS + 2} values of r, got {len(self.r)}")
        side = math.isqrt(len(self.du))
        if side * side != len(self.du) or not 4 <= side <= MAX_SIDE:
            raise ValueError(f"spline needs n * n values of du with n from 4 to {MAX_SIDE}, got {len(self.du)}")
        if len(self.dv) != len(self.du):
            raise ValueError(f"spline needs as many values of dv as of du, got {len(self.dv)} and {len(self.du)}")

    def kernel_values(self) -> dict[str, Any]:
        # `derived` holds them as arrays: the same compiled code serves all counts.
        return {name: value for name, value in super().kernel_values().items() if name not in {"r", "du", "dv"}}

    def affine(self) -> tuple[float, float, float, float, float, float]:
        return 1.0, 0.0, 0.0, 1.0, self.cx, self.cy

    def affine_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        return {"cx": (1.0, 0.0), "cy": (0.0, 1.0)}

    @classmethod
    def fit(cls, bearings: ArrayLike, pixels: ArrayLike, *, fixed: Sequence[str] = ()) -> Self:
        # The knots are fixed: they mark the end of the data.
        return super().fit(bearings, pixels, fixed=(*fixed, "reach", "extent"))

    @classmethod
    def variants(cls, corners: int) -> Mapping[str, VariantFit]:
        cells = MIN_CALIBRATED_CELLS if corners < MANY_CORNERS else MAX_CALIBRATED_CELLS
        return {
            cls.name: lambda bearings, pixels, fixed=(): cls.initial_model(bearings, pixels, CALIBRATED_SPANS, cells)
        }

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return a linear fit of the profile without a correction."""
        yield cls.initial_model(bearings, pixels, SPANS, CELLS)

    @classmethod
    def initial_model(cls, bearings: Array, pixels: Array, spans: int, cells: int) -> Self:
        """Return a linear fit of a profile with the centre of the best equidistant model.

        The profile has `spans` spans; the correction has `cells` times `cells` cells and is 0.
        """
        lens = Equidistant.fit(bearings, pixels)
        x, y, z = bearings.T
        theta = np.arctan2(np.hypot(x, y), z)
        radius = np.hypot(pixels[:, 0] - lens.cx, pixels[:, 1] - lens.cy)
        reach = min(1.02 * float(theta.max()), np.pi)
        weight = basis(theta * (spans / reach), spans)
        weight[2] += weight[0]
        bent = SMOOTHING * np.diff(np.eye(spans + 2), 2, axis=0)
        design = np.concatenate([(theta * weight[1:]).T, bent])
        r = np.linalg.lstsq(design, np.append(radius, np.zeros(spans)), rcond=None)[0]
        flat = (0.0,) * (cells + 3) ** 2
        r = tuple(map(float, np.maximum(r, 1e-3)))
        return cls(lens.cx, lens.cy, reach, 1.05 * float(radius.max()), r, flat, flat)

    @classmethod
    def example(cls) -> Self:
        # Polynomials, which have exact control values: p - h^2 p''/6 at knots h apart.
        knots, h = 1.9 / 8 * np.arange(10), 1.9 / 8
        r = 281.0 - 5.0 * (knots**2 - h**2 / 3) - 1.5 * (knots**3 - h**2 * knots)
        knots, h = np.linspace(-5 / 3, 5 / 3, 6), 2 / 3
        p0, p1, p2, p3 = np.ones(6), knots, knots**2 - h**2 / 3, knots**3 - h**2 * knots
        du = 0.6 * np.outer(p0, p2) + 0.4 * np.outer(p1, p1) + 0.3 * np.outer(p1, p0) - 0.17 * np.outer(p2, p3)
        dv = 0.5 * np.outer(p2, p0) - 0.3 * np.outer(p1, p1) + 0.2 * np.outer(p0, p1) + 0.13 * np.outer(p3, p2)
        r, du, dv = (tuple(map(float, np.ravel(values))) for values in (r, du, dv))
        return cls(cx=479.5, cy=481.0, reach=1.9, extent=560.0, r=r, du=du, dv=dv)
