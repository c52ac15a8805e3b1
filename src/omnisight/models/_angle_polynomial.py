"""Profiles r(theta) that are polynomials of the angle, inverted by Newton's method."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from omnisight.models._elementwise import (
    any_of,
    atan2,
    elementwise,
    model_method,
    rounding,
    sine_cosine,
    sqrt,
    where,
    without_gradient,
)
from omnisight.models._planar_distortion import FOLD_MARGIN
from omnisight.models._polynomial_roots import first_positive_root
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Array

# Largest square of the last Newton step over w of `inverse_radial_scale`, in units of `rounding`: 1e-13.
MAX_SQUARED_STEP = 450.0


@model_method
def radius_and_slope(m: Any, theta: Any) -> Any:
    """Return r(theta) and its derivative."""


@model_method
def initial_angle(m: Any, r: Any, q: Any, w: Any) -> Any:
    """Return the angle from which Newton's method starts: r times the sum of m.i0, m.i1, ... times `start_terms`."""


@elementwise
def angle_newton_step(m: Any, theta: Any, r: Any) -> Any:
    """Return theta after a Newton step towards r(theta) = r, clipped to the valid cone, and the step."""
    value, slope = radius_and_slope(m, theta)
    step = (value - r) / slope
    theta = theta - step
    theta = where(theta < m.theta_max, theta, m.theta_max)
    return where(theta > 0.0, theta, 0.0), step


class AnglePolynomial(ProfileCamera):
    """A polynomial r(theta) with the slope 1 on the axis, valid up to the angle where it stops increasing.

    Newton's method starts from a polynomial that is fitted to the inverse once per camera. A subclass implements
    `radius_and_slope`, `initial_angle` with `start_terms`, `slope_polynomial` with `slope_angle`, and
    `radial_scale_derivatives`.
    """

    @staticmethod
    def radius_and_slope(m: Any, theta: Any) -> Any:
        """Return r(theta) and its derivative."""
        raise NotImplementedError

    @staticmethod
    def initial_angle(m: Any, r: Any, q: Any, w: Any) -> Any:
        """Return the angle from which Newton's method starts."""
        raise NotImplementedError

    @staticmethod
    def start_terms(q: Array, w: Array) -> Sequence[Array]:
        """Return the terms of theta/r for q = r/r(fold) and w = sqrt(1 - q^2).

        theta(r) behaves like a square root at the fold, so it is smooth in w.
        """
        raise NotImplementedError

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        r, _ = radius_and_slope(m, atan2(s, c))
        return where(s > 1e-9, r / where(s > 1e-9, s, 1.0), 1.0)

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        q = r * m.inverse_fold_radius
        w = 1.0 - q * q
        w = sqrt(where(w > 0.0, w, 0.0))
        theta = initial_angle(m, r, q, w)
        theta = where(theta < m.theta_max, theta, m.theta_max)
        # The error is the square of the last step over w, which vanishes at the fold. Beyond the rim no angle exists.
        largest = MAX_SQUARED_STEP * rounding(r) * w
        # Unrolled: the compiled loop over the points then vectorizes.
        theta, step = angle_newton_step(m, theta, r)
        if max_iterations is not None:
            for _ in range(max_iterations):
                theta, step = angle_newton_step(m, theta, r)
                if not any_of((step * step >= largest) & (r <= m.r_last)):
                    break
        theta, step = angle_newton_step(m, without_gradient(theta), r)
        theta, step = angle_newton_step(m, theta, r)
        s, c = sine_cosine(theta)
        converged = (step * step < largest) | (r > m.r_last)
        return where(converged, where(r > 1e-9, s / where(r > 1e-9, r, 1.0), 1.0), np.inf), c

    def unprojection_constants(self) -> dict[str, Any]:
        theta = self.fold * np.sin(np.linspace(0, np.pi / 2, 65)[1:])  # denser towards the fold
        r, _ = self.radius_and_slope(self, theta)
        q = r / r[-1]
        terms = np.stack(self.start_terms(q, np.sqrt(np.maximum(1 - q * q, 0))), axis=-1)
        start = np.linalg.lstsq(terms, theta / r, rcond=None)[0]
        inverse = {
            "inverse_fold_radius": 1 / float(r[-1]),
            # Slightly larger than the last angle, because the edge itself is valid.
            "theta_max": self.theta_max * (1 + 1e-12),
            "r_last": self.radius_max(),
        }
        return super().unprojection_constants() | {f"i{i}": float(value) for i, value in enumerate(start)} | inverse

    @cached_property
    def fold(self) -> float:
        """The angle (radians) where r(theta) stops increasing, at most 180 degrees."""
        return float(min(np.pi, self.slope_angle(first_positive_root(self.slope_polynomial()))))

    @property
    def theta_max(self) -> float:
        return self.fold if self.fold == np.pi else self.fold * (1 - FOLD_MARGIN)

    def radius_max(self) -> float:
        r, _ = self.radius_and_slope(self, self.theta_max)
        return float(r)
