"""The pinhole camera with a rational radial distortion, eight coefficients."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import RationalDistortion
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._projector import Array
from omnisight.models.equidistant import Equidistant
from omnisight.models.pinhole import PinholeProfile

# Largest slope of the radius relative to the centre: beyond it the rational function approaches a pole.
MAX_RELATIVE_SLOPE = 4.0


@dataclass(frozen=True)
class RationalPinhole(RationalDistortion, PinholeProfile):
    """Pinhole camera with OpenCV's eight coefficients; ROS `rational_polynomial`, COLMAP FULL_OPENCV.

    On the plane x/z, y/z, with r^2 = x^2 + y^2 and d = (1 + k1 r^2 + k2 r^4 + k3 r^6)/(1 + k4 r^2 + k5 r^4 + k6 r^6):

    x' = x d + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = y d + p1 (r^2 + 2 y^2) + 2 p2 x y

    Valid for theta < 90 degrees and up to the radius where x' stops increasing, or increases 4 times as fast as in the
    centre: beyond, d approaches a pole. Claus and Fitzgibbon, A rational function lens distortion model, CVPR
    2005, as OpenCV writes it.
    """

    auto_max_theta: ClassVar[float] = 0.0

    fx: float = parameter("focal length along x", unit="px")
    fy: float = parameter("focal length along y", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    k1: float = parameter("radial distortion, numerator", prior_sigma=1.0, truncated_start=True)
    k2: float = parameter("radial distortion, numerator", prior_sigma=1.0, truncated_start=True)
    p1: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    p2: float = parameter("tangential distortion", prior_sigma=0.02, start_zero=True)
    k3: float = parameter("radial distortion, numerator", prior_sigma=1.0, truncated_start=True)
    k4: float = parameter("radial distortion, denominator", prior_sigma=1.0, truncated_start=True)
    k5: float = parameter("radial distortion, denominator", prior_sigma=1.0, truncated_start=True)
    k6: float = parameter("radial distortion, denominator", prior_sigma=1.0, truncated_start=True)

    def radial_fold(self) -> float:
        # The root of the denominator lies beyond.
        d = np.array([1.0, self.k4, self.k5, self.k6])
        steep = np.array(self.slope_polynomial()) - MAX_RELATIVE_SLOPE * np.convolve(d, d)
        return min(super().radial_fold(), first_positive_root(list(steep)) ** 0.5)

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return a pinhole, and a linear fit of both polynomials about the centre of the best equidistant model."""
        from scipy.optimize import lsq_linear  # imported on use: scipy slows down the first projection

        yield from super().initial_models(bearings, pixels)
        front = bearings[:, 2] > 0.05 * np.linalg.norm(bearings, axis=1)
        if front.sum() < 8:
            return
        lens = Equidistant.fit(bearings[front], pixels[front])
        x, y, z = bearings[front].T
        r = np.hypot(x, y) / z
        observed = np.hypot(*((pixels[front] - (lens.cx, lens.cy)) / (lens.fx, lens.fy)).T)
        # observed (1 + k4 r^2 + ...) = f r (1 + k1 r^2 + ...), weighted by about the inverse of the denominator.
        even = (r[:, None] ** 2) ** np.arange(1, 4)
        weight = 1 / (1 + r * r)
        design = np.column_stack([r, r[:, None] * even, -observed[:, None] * even]) * weight[:, None]
        low = [-np.inf] * 4 + [0.0] * 3
        f, f1, f2, f3, *denominator = map(float, lsq_linear(design, observed * weight, (low, np.inf), method="bvls").x)
        yield cls(lens.fx * f, lens.fy * f, lens.cx, lens.cy, f1 / f, f2 / f, 0.0, 0.0, f3 / f, *denominator)

    @classmethod
    def example(cls) -> Self:
        return cls(
            fx=610.0,
            fy=612.0,
            cx=639.5,
            cy=362.0,
            k1=0.31,
            k2=0.05,
            p1=4e-4,
            p2=-3e-4,
            k3=0.002,
            k4=0.62,
            k5=0.12,
            k6=0.011,
        )
