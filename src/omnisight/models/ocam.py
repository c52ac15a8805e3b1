"""Scaramuzza's polynomial model."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from omnisight.models._camera_model import VariantFit
from omnisight.models._elementwise import any_of, elementwise, has_derivatives, rounding, sqrt, where, without_gradient
from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array, Partial
from omnisight.models.equidistant import Equidistant

# Degrees of the polynomial that a calibration compares.
CALIBRATED_DEGREES = (3, 4, 5, 6)
# Terms of the polynomial that starts the projection, and the k of its variable t/(k + t), t = tan(theta/2), which is
# finite up to 180 degrees. With this k the largest error is 1e-6 to 5e-3 of the radius, with k near 0 or infinity 0.5.
START_TERMS, START_SCALE = 12, 3.0
# Largest square of the last Newton step, relative to the squared radius of the rim, in units of `rounding`: 1e-14.
MAX_SQUARED_STEP = 45.0
# Largest radius of a polynomial that never folds, in focal lengths.
MAX_RADIUS_FOCALS = 8.0


@elementwise
def radius_newton_step(m: Any, r: Any, low: Any, high: Any, s: Any, c: Any) -> Any:
    """Return r after a Newton step towards s f(r) = c r, bracket and step; bisect if r is outside the bracket."""
    r = where((r >= low) & (r <= high), r, 0.5 * (low + high))
    f, slope = 0.0, 0.0
    for i in range(len(m.a) - 1, 0, -1):
        slope = slope * r + f
        f = f * r + m.a[i]
    slope, f = slope * r * r + 2.0 * r * f, f * r * r + m.a[0]
    value = s * f - c * r  # positive before the root
    step = value / (c - s * slope)
    return r + step, where(value > 0.0, r, low), where(value > 0.0, high, r), step


@dataclass(frozen=True)
class Ocam(ProfileCamera):
    """Scaramuzza's omnidirectional camera: a pixel at (x, y) from the centre has the bearing (x, y, f(r)).

    f(r) = a0 + a2 r^2 + a3 r^3 + ...,  a1 = 0, r in pixels.

    The pixel is the stretched plane point: row = c y + d x + cy, column = e y + x + cx. In OCamCalib's own frame x
    points down, y right and z back; its coefficients have the other sign. a0 in pixels and the one in the
    stretch matrix fix the scale that eq. (7) of the chapter does not determine.

    The projection is the exact inverse: the first root of sin(theta) f(r) = cos(theta) r, by Newton's method kept
    inside a bracket. Valid up to the radius where theta(r) stops increasing (`fold`). Scaramuzza, Martinelli and
    Siegwart, A flexible technique for accurate omnidirectional camera calibration and structure from motion, ICVS 2006.
    """

    needs_axis: ClassVar[bool] = True

    cx: float = parameter("distortion centre", unit="px")
    cy: float = parameter("distortion centre", unit="px")
    c: float = parameter("stretch: rows per y")
    d: float = parameter("stretch: rows per x")
    e: float = parameter("stretch: columns per y", free=False)  # equivalent to a rotation of the camera
    a: tuple[float, ...] = parameter("polynomial f(r), coefficients of r^0, r^2, r^3, ... in px^(1-i)")

    @staticmethod
    def coefficient_names(count: int, field: str = "a") -> tuple[str, ...]:
        return tuple(f"{field}{i}" for i in (0, *range(2, count + 1)))

    @cached_property
    def polynomial(self) -> Array:
        """f(r) as coefficients from r^0 up, a1 = 0 included."""
        return np.array((self.a[0], 0.0, *self.a[1:]))

    @cached_property
    def fold(self) -> float:
        """The radius (px) where theta(r) stops increasing, beyond which it is not injective; inf if it never does."""
        return first_positive_root(self.slope_polynomial())

    def slope_polynomial(self) -> list[float]:
        # For the angle, not the radius: d theta/dr has the sign of f - r f' = a0 - a2 r^2 - 2 a3 r^3 - ...
        return [float((1 - i) * value) for i, value in enumerate(self.polynomial)]

    def slope_angle(self, x: float) -> float:
        return float(np.arctan2(x, np.polynomial.polynomial.polyval(x, self.polynomial)))

    def radius_max(self) -> float:
        return min(self.fold * (1 - FOLD_MARGIN), MAX_RADIUS_FOCALS * abs(self.a[0]))

    @property
    def theta_max(self) -> float:
        radius = self.radius_max()
        return float(np.arctan2(radius, np.polynomial.polynomial.polyval(radius, self.polynomial)))

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        q = s / (START_SCALE * (1.0 + c) + s) * m.q_scale  # 1 at the rim
        past = q > 1.0
        q = where(q < 1.0, q, 1.0)
        r = 0.0 * q
        for i in range(len(m.start) - 1, -1, -1):
            r = r * q + m.start[i]
        r = r * q
        low, high = 0.0 * q, m.r_max * (1.0 + 1e-9) + 0.0 * q
        # The error is the square of the last step. Beyond the rim no radius exists.
        largest = MAX_SQUARED_STEP * rounding(s) * m.r_max * m.r_max
        r, low, high, step = radius_newton_step(m, r, low, high, s, c)
        if max_iterations is not None:
            for _ in range(max_iterations):
                if not any_of((step * step >= largest) & (q < 1.0)):
                    break
                r, low, high, step = radius_newton_step(m, r, low, high, s, c)
        if max_iterations is None or has_derivatives(r):
            # Unrolled: the compiled loop over the points then vectorizes.
            r, low, high, step = radius_newton_step(m, without_gradient(r), low, high, s, c)
            r, low, high, step = radius_newton_step(m, r, low, high, s, c)
        converged = past | (step * step < largest)
        return where(converged, where(s > 1e-9, r / where(s > 1e-9, s, 1.0), m.a[0]), np.inf)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        f = 0.0
        for i in range(len(m.a) - 1, 0, -1):
            f = f * r + m.a[i]
        f = f * r2 + m.a[0]
        h = 1.0 / sqrt(r2 + f * f)
        return h, h * f

    def projection_constants(self) -> dict[str, Any]:
        radius = self.radius_max()
        r = radius * 0.5 * (1 - np.cos(np.pi * np.arange(1, 97) / 96))
        f = np.polynomial.polynomial.polyval(r, self.polynomial)
        n = np.hypot(r, f)
        t = np.where(f > 0, r / np.where(f > 0, n + f, 1.0), (n - f) / r)  # tan(theta/2), the sum without cancellation
        q = t / (START_SCALE + t)
        q_max, q = q[-1], q / q[-1]
        start = np.linalg.lstsq(q[:, None] ** np.arange(START_TERMS), r / q, rcond=None)[0]
        return {
            **super().projection_constants(),
            "r_max": radius,
            "q_scale": 1 / float(q_max),
            "start": tuple(map(float, start)),
        }

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        # From F = s f(r) - c r = 0 with r = s g:  dr/da_i = s r^i/(c - s f'),  dr/dtheta = (c f + s r)/(c - s f').
        f = np.polynomial.Polynomial(self.polynomial)
        r = s * g
        below = c - s * f.deriv()(r)
        on_axis = (s < 1e-4) & (c > 0)
        slope = (c * f(r) + s * r) / below
        # Near the axis r = a0 tan(theta) + a2 a0^2 theta^3 + ...:  dg/dc = -a0 - 2 a2 a0^2 + O(theta).
        limit = -self.a[0] - 2 * (self.a[1] * self.a[0] ** 2 if len(self.a) > 1 else 0.0)
        dg_dc = np.where(on_axis, limit, -(slope - g * c) / np.where(on_axis, 1.0, s * s))
        by_a = np.empty((len(self.a), len(r)))
        by_a[0] = 1 / below
        for i in range(1, len(self.a)):
            by_a[i] = by_a[i - 1] * (r * r if i == 1 else r)
        return dg_dc, {"a": by_a}

    def affine(self) -> tuple[float, float, float, float, float, float]:
        return 1.0, self.e, self.d, self.c, self.cx, self.cy

    def affine_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        return {"cx": (1.0, 0.0), "cy": (0.0, 1.0), "c": (0.0, y), "d": (0.0, x), "e": (y, 0.0)}

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return fits of polynomials of three degrees; 4 is the default of OCamCalib."""
        return cls.initial_models_of_degrees(bearings, pixels, (4, 6, 8))

    @classmethod
    def initial_models_of_degrees(cls, bearings: Array, pixels: Array, degrees: Sequence[int]) -> Iterator[Self]:
        """Return linear fits of polynomials, with the centre and aspect ratio of the best equidistant model."""
        lens = Equidistant.fit(bearings, pixels)
        x, y, z = bearings.T / np.linalg.norm(bearings, axis=1)
        plane = (pixels - (lens.cx, lens.cy)) / (1.0, lens.fy / lens.fx)
        r = np.hypot(plane[:, 0], plane[:, 1])
        s = np.hypot(x, y)
        scale = r.max()
        for degree in degrees:
            powers = np.array((0, *range(2, degree + 1)))
            # s f(r) = z r, in the unit of the largest radius.
            design, right = s[:, None] * (r[:, None] / scale) ** powers, z * r / scale
            a = np.linalg.lstsq(design, right, rcond=None)[0]
            if a[0] <= 0:  # a0 is not observable far from the axis: take it from the equidistant model
                a[0] = lens.fx / scale
                a[1:] = np.linalg.lstsq(design[:, 1:], right - a[0] * design[:, 0], rcond=None)[0]
            a *= scale / scale**powers
            yield cls(lens.cx, lens.cy, lens.fy / lens.fx, 0.0, 0.0, a=tuple(map(float, a)))

    @classmethod
    def variants(cls, corners: int) -> Mapping[str, VariantFit]:
        return {f"ocam degree {degree}": partial(cls._fit_degree, degree) for degree in CALIBRATED_DEGREES}

    @classmethod
    def _fit_degree(cls, degree: int, bearings: Array, pixels: Array, *, fixed: Sequence[str] = ()) -> Self:
        """Fit a polynomial of one degree linearly; the fit has no iterations in which parameters could stay fixed."""
        return next(cls.initial_models_of_degrees(bearings, pixels, (degree,)))

    @classmethod
    def example(cls) -> Self:
        return cls(cx=512.3, cy=383.1, c=1.0008, d=4e-4, e=-3e-4, a=(211.0, -1.71e-3, 1.1e-6, -3.9e-9))
