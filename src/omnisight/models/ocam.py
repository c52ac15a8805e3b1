"""Scaramuzza's polynomial model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from omnisight.models._central import Central
from omnisight.models._elementwise import radius_step, settled, where
from omnisight.models._parameter import parameter
from omnisight.models._planar import FOLD_MARGIN, first_positive_root
from omnisight.models._projector import Array, Partial

START_TERMS = 12
# A polynomial that never folds would be followed to this many focal lengths from the centre.
FARTHEST = 8.0


@dataclass(frozen=True)
class Ocam(Central):
    """Scaramuzza's omnidirectional camera: a pixel at (x, y) from the centre has the bearing (x, y, f(r)).

    f(r) = a0 + a2 r^2 + a3 r^3 + ...,  a1 = 0, r in pixels.

    The pixel is the stretched plane point: row = c y + d x + cy, column = e y + x + cx. In OCamCalib's own frame x
    points down, y right and z back, so that its coefficients have the other sign. a0 in pixels and the one in the
    stretch matrix fix the scale that eq. (7) of the chapter leaves open.

    The projection is the exact inverse: the first root of sin(theta) f(r) = cos(theta) r, by Newton's method kept
    inside a bracket. Valid up to the radius where theta(r) stops growing (`fold`). Scaramuzza, Martinelli and
    Siegwart, A flexible technique for accurate omnidirectional camera calibration and structure from motion, ICVS 2006.
    """

    cx: float = parameter("distortion centre", unit="px")
    cy: float = parameter("distortion centre", unit="px")
    c: float = parameter("stretch: rows per y")
    d: float = parameter("stretch: rows per x")
    e: float = parameter("stretch: columns per y", free=False)  # a turn of the camera does the same
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
        """The radius (px) where theta(r) stops growing and the image folds over; inf if it never does."""
        return first_positive_root(self.growth())

    def growth(self) -> list[float]:
        # Of the angle, not the radius: d theta/dr has the sign of f - r f' = a0 - a2 r^2 - 2 a3 r^3 - ...
        return [float((1 - i) * value) for i, value in enumerate(self.polynomial)]

    def growth_angle(self, x: float) -> float:
        return float(np.arctan2(x, np.polynomial.polynomial.polyval(x, self.polynomial)))

    def radius_max(self) -> float:
        return min(self.fold * (1 - FOLD_MARGIN), FARTHEST * abs(self.a[0]))

    @property
    def theta_max(self) -> float:
        radius = self.radius_max()
        return float(np.arctan2(radius, np.polynomial.polynomial.polyval(radius, self.polynomial)))

    @staticmethod
    def gain(m: Any, s: Any, c: Any, effort: Any) -> Any:
        t = s / (1.0 + c) * m.t_scale  # tan(theta/2), 1 at the rim
        past = t > 1.0
        t = where(t < 1.0, t, 1.0)
        r = 0.0 * t
        for i in range(len(m.start) - 1, -1, -1):
            r = r * t + m.start[i]
        r = r * t
        low, high = 0.0 * t, m.r_max * (1.0 + 1e-9) + 0.0 * t
        r, low, high, step = radius_step(m, r, low, high, s, c)
        if effort is None:
            # Written out, not in a loop: so the compiled loop over the points vectorises.
            r, low, high, step = radius_step(m, r, low, high, s, c)
            r, low, high, step = radius_step(m, r, low, high, s, c)
        else:
            for _ in range(effort):
                if settled(where(past, 0.0, step), 1e-7 * m.r_max):
                    break
                r, low, high, step = radius_step(m, r, low, high, s, c)
        # A small last step leaves its square; past the rim there is nothing to find.
        found = past | (np.abs(step) < 1e-7 * m.r_max)
        return where(found, where(s > 1e-9, r / where(s > 1e-9, s, 1.0), m.a[0]), np.inf)

    @staticmethod
    def radius_step(m: Any, r: Any, low: Any, high: Any, s: Any, c: Any) -> Any:
        """Give r after a Newton step towards s f(r) = c r (or half the bracket if it leaves it), bracket, step."""
        r = where((r >= low) & (r <= high), r, 0.5 * (low + high))
        f, slope = 0.0, 0.0
        for i in range(len(m.a) - 1, 0, -1):
            slope = slope * r + f
            f = f * r + m.a[i]
        slope, f = slope * r * r + 2.0 * r * f, f * r * r + m.a[0]
        value = s * f - c * r  # positive before the root
        step = value / (c - s * slope)
        return r + step, where(value > 0.0, r, low), where(value > 0.0, high, r), step

    @staticmethod
    def ungain(m: Any, r: Any, r2: Any, effort: Any) -> Any:
        f = 0.0
        for i in range(len(m.a) - 1, 0, -1):
            f = f * r + m.a[i]
        f = f * r2 + m.a[0]
        h = 1.0 / np.sqrt(r2 + f * f)
        return h, h * f

    def derived(self) -> dict[str, Any]:
        radius = self.radius_max()
        r = radius * 0.5 * (1 - np.cos(np.pi * np.arange(1, 97) / 96))
        f = np.polynomial.polynomial.polyval(r, self.polynomial)
        n = np.hypot(r, f)
        t = np.where(f > 0, r / np.where(f > 0, n + f, 1.0), (n - f) / r)  # tan(theta/2), the sum without a loss
        q = t / t[-1]
        start = np.linalg.lstsq(q[:, None] ** np.arange(START_TERMS), r / q, rcond=None)[0]
        return {**super().derived(), "r_max": radius, "t_scale": 1 / float(t[-1]), "start": tuple(map(float, start))}

    def gain_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
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
    def starts(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Fit polynomials of three degrees; 4 is what OCamCalib takes unless told otherwise."""
        return cls.starts_of_degrees(bearings, pixels, (4, 6, 8))

    @classmethod
    def starts_of_degrees(cls, bearings: Array, pixels: Array, degrees: Sequence[int]) -> Iterator[Self]:
        """Fit polynomials linearly, about the centre and aspect that an equidistant lens would have."""
        from omnisight.models.equidistant import Equidistant

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
            if a[0] <= 0:  # what a mirror shows far from its middle may leave open: then as the equidistant lens has it
                a[0] = lens.fx / scale
                a[1:] = np.linalg.lstsq(design[:, 1:], right - a[0] * design[:, 0], rcond=None)[0]
            a *= scale / scale**powers
            yield cls(lens.cx, lens.cy, lens.fy / lens.fx, 0.0, 0.0, a=tuple(map(float, a)))

    @classmethod
    def example(cls) -> Self:
        return cls(cx=512.3, cy=383.1, c=1.0008, d=4e-4, e=-3e-4, a=(211.0, -1.71e-3, 1.1e-6, -3.9e-9))
