"""Central cameras with an axis: a profile r(theta), a planar distortion, an affine map to pixels."""

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from omnisight.models._camera_model import CameraModel
from omnisight.models._elementwise import MAX_ITERATIONS, absolute, model_method, sqrt, where
from omnisight.models._planar_distortion import NoDistortion, distort, undistort
from omnisight.models._polynomial_roots import first_positive_root, positive_roots
from omnisight.models._projector import MIN_RELATIVE_GROWTH, Array, NearFold, Partial


@model_method
def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
    """Return r(theta)/sin(theta) from s = sin(theta), c = cos(theta)."""


@model_method
def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
    """Return (sin(theta)/r, cos(theta)) from the radius r and its square."""


class DerivativesByPoint(NamedTuple):
    """Projections of points (N, 3), their derivatives, and what those by the parameters are computed from.

    Attributes
    ----------
    pixels, valid, by_point
        As `project_with_jacobians` returns them.
    plane, distorted
        (x, y), (N,) each, of the plane before and after the distortion.
    by_scale
        Derivatives of both pixel coordinates by the radial scale.
    scale_by_params
        Derivatives of the radial scale by its parameters.
    """

    pixels: Array
    valid: NDArray[np.bool_]
    by_point: Array
    plane: tuple[Array, Array]
    distorted: tuple[Array, Array]
    by_scale: list[Array]
    scale_by_params: dict[str, Array]


class ProfileCamera(NoDistortion, CameraModel):
    """The base of all cameras that consist of r(theta), a planar distortion and an affine map.

    The profile is written as the radial scale g = r(theta)/sin(theta), elementwise from s = sin(theta) = rho/n and
    c = cos(theta) = z/n. The point of the plane is g (x, y)/n: most models need no trigonometry, and nothing is
    singular on the axis. A model implements `radial_scale`, `inverse_radial_scale`, `radial_scale_derivatives`,
    `theta_max` and `radius_max`. `INITIAL_SHAPES` lists values of the shape parameters from which `fit` starts.
    """

    INITIAL_SHAPES: ClassVar[tuple[dict[str, Any], ...]] = ({},)

    @staticmethod
    def radial_scale(m: Any, s: Any, c: Any, max_iterations: Any) -> Any:
        """Return r(theta)/sin(theta)."""
        raise NotImplementedError

    @staticmethod
    def inverse_radial_scale(m: Any, r: Any, r2: Any, max_iterations: Any) -> Any:
        """Return (sin(theta)/r, cos(theta))."""
        raise NotImplementedError

    def radial_scale_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        """Return dg/d cos(theta), and dg/d parameter by field: (N,), or (K, N) for a tuple of K parameters."""
        raise NotImplementedError

    # -- the affine map; models with another one (stretch matrix) override these two ---------------------------

    def affine(self) -> tuple[float, float, float, float, float, float]:
        """Return (a11, a12, a21, a22, u0, v0): pixel = A plane + centre; see `derived`."""
        m: Any = self
        return m.fx, getattr(m, "skew", 0.0), 0.0, m.fy, m.cx, m.cy

    def affine_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        """Return the derivatives of the pixel by the parameters of the affine map."""
        return {"fx": (x, 0.0), "fy": (0.0, y), "skew": (y, 0.0), "cx": (1.0, 0.0), "cy": (0.0, 1.0)}

    # -- the slope of the radius; profiles with a polynomial in the angle override these two ------------------

    def slope_polynomial(self) -> list[float]:
        """Return a polynomial with the sign of the slope of the radius: coefficients from the constant up.

        Each coefficient is linear in every single parameter. The variable is r^2 of the plane.
        """
        return [1.0]

    def slope_angle(self, x: float) -> float:
        """Return the angle (radians) at a value of the variable of `slope_polynomial`."""
        if (r := x**0.5) >= self.radius_max():
            return self.theta_max
        h, c = self.inverse_radial_scale(self.kernel, r, x, MAX_ITERATIONS)
        return float(np.arctan2(h * r, c))

    @cached_property
    def near_folds(self) -> list[NearFold]:
        terms = self.slope_polynomial()
        slope = [i * term for i, term in enumerate(terms)][1:]
        folds: list[NearFold] = []
        if all(term >= 0 for term in slope):
            return folds
        for x in positive_roots(slope):
            growth = float(polyval(x, terms)) / terms[0]
            if 0 < growth < MIN_RELATIVE_GROWTH and polyval(x, polyder(slope)) > 0 and x < first_positive_root(terms):
                moved = [self.with_params(self.params + one).slope_polynomial() for one in np.eye(self.params.size)]
                by_params = np.array(moved) - terms
                by_params = (polyval(x, by_params.T) - growth * by_params[:, 0]) / terms[0]
                folds.append(NearFold(self.slope_angle(x), growth, by_params))
        return folds

    # -- the protocol -----------------------------------------------------------------------------------------

    def projection_constants(self) -> dict[str, Any]:
        c_min, radius_max = self._rim
        return {"c_min": c_min, "r2_max": radius_max**2}

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        return dict(zip(("a11", "a12", "a21", "a22", "u0", "v0"), cls.affine(m), strict=True))

    @cached_property
    def _rim(self) -> tuple[float, float]:
        """Cosine of the angle that bounds the valid cone, and radius that bounds the valid disc of the plane."""
        theta_max = self.theta_max
        return -1.0 if theta_max >= np.pi else float(np.cos(theta_max)), min(self.one_to_one_radius, self.radius_max())

    def unprojection_constants(self) -> dict[str, Any]:
        c_min, radius_max = self._rim
        # Points projected from the rim itself must be unprojected in spite of rounding.
        return {"c_back": c_min - 1e-9, "r2_back": radius_max**2 * (1 + 1e-9)}

    @property
    def rim(self) -> float:
        low, high = 0.0, self.theta_max
        _, radius_max = self._rim
        if self.one_to_one_radius >= self.radius_max() < np.inf:
            return high
        # Bracket the first angle at which the radius exceeds that of the one-to-one disc, more closely in each round.
        for _ in range(5):
            theta = np.linspace(low, high, 33)
            with np.errstate(all="ignore"):
                radius = np.sin(theta) * self.radial_scale(
                    self.projection_values, np.sin(theta), np.cos(theta), MAX_ITERATIONS
                )
            past = np.flatnonzero(~(radius <= radius_max))
            if not len(past):
                return high
            low, high = float(theta[max(past[0] - 1, 0)]), float(theta[past[0]])
        return low

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
        rho2 = x * x + y * y
        inverse_n = 1.0 / sqrt(rho2 + z * z)
        c = z * inverse_n
        g = radial_scale(m, sqrt(rho2) * inverse_n, c, max_iterations) * inverse_n
        px, py = g * x, g * y
        valid = (c > m.c_min) & (px * px + py * py <= m.r2_max)
        px, py = distort(m, px, py)
        u = m.a11 * px + m.a12 * py + m.u0
        return where(g < np.inf, u, g), m.a21 * px + m.a22 * py + m.v0, valid

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
        du, dv = u - m.u0, v - m.v0
        determinant = m.a11 * m.a22 - m.a12 * m.a21
        qx, qy = (m.a22 * du - m.a12 * dv) / determinant, (m.a11 * dv - m.a21 * du) / determinant
        px, py, converged = undistort(m, qx, qy, max_iterations)
        r2 = px * px + py * py
        h, c = inverse_radial_scale(m, sqrt(r2), r2, max_iterations)
        valid = converged & (r2 <= m.r2_back) & (c > m.c_back)
        return where(converged & (absolute(h) != np.inf), h * px, np.inf), h * py, c, valid

    def project_with_point_jacobian(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        with np.errstate(all="ignore"):
            at = self._derivatives_by_point(points)
        return at.pixels, at.valid, at.by_point

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        at = self._derivatives_by_point(points)
        a11, a12, a21, a22, _, _ = self.affine()
        partials = self.affine_partials(*at.distorted)
        for name, (dx, dy) in self.distort_partials(*at.plane).items():
            partials[name] = linear_combination(a11, dx, a12, dy), linear_combination(a21, dx, a22, dy)
        for name, dg in at.scale_by_params.items():
            partials[name] = (dg * at.by_scale[0], dg * at.by_scale[1])
        by_params = np.empty((self.params.size, 2, len(points)))
        start = 0
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, field.name)
            stop = start + (len(value) if isinstance(value, tuple) else 1)
            for axis, d in enumerate(partials[field.name]):
                by_params[start:stop, axis] = d
            start = stop
        return at.pixels, at.valid, at.by_point, by_params.T

    def _derivatives_by_point(self, points: Array) -> "DerivativesByPoint":
        x, y, c = points.T.copy()
        over_n = 1.0 / np.sqrt(x * x + y * y + c * c)
        x, y, c = x * over_n, y * over_n, c * over_n
        s = np.sqrt(x * x + y * y)
        g = self.radial_scale(self.projection_values, s, c, MAX_ITERATIONS)
        px, py = g * x, g * y
        qx, qy = self.distort(self.projection_values, px, py)
        a11, a12, a21, a22, u0, v0 = self.affine()
        pixels = np.empty((len(points), 2))
        pixels[:, 0], pixels[:, 1] = a11 * qx + a12 * qy + u0, a21 * qx + a22 * qy + v0
        valid = (c > self.projection_values.c_min) & (px * px + py * py <= self.projection_values.r2_max)
        # With p = g(c) b_xy:  dp/db_xy = g (I - b_xy b^T) and dc/dpoint = (e_z - c b)/n.
        xx, xy, yx, yy = self.distort_jacobian(self.projection_values, px, py)
        dg_dc, dg_dparams = self.radial_scale_derivatives(s, c, g)
        g_n, dg_n = g * over_n, dg_dc * over_n
        radial_n = g_n + dg_n * c
        # The derivatives of all points by one coordinate are contiguous in memory: they are written and read so.
        by_point, by_scale = np.empty((3, 2, len(points))), list[Array]()
        for axis, (jx, jy) in enumerate(
            ((a11 * xx + a12 * yx, a11 * xy + a12 * yy), (a21 * xx + a22 * yx, a21 * xy + a22 * yy))
        ):
            by_scale.append(jx * x + jy * y)
            by_norm = -radial_n * by_scale[axis]
            by_point[0, axis] = g_n * jx + by_norm * x
            by_point[1, axis] = g_n * jy + by_norm * y
            by_point[2, axis] = dg_n * by_scale[axis] + by_norm * c
        return DerivativesByPoint(pixels, valid, by_point.T, (px, py), (qx, qy), by_scale, dg_dparams)

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return the best affine map for each of `INITIAL_SHAPES` (linear least squares)."""
        example = cls.example()
        x, y, c = bearings.T / np.linalg.norm(bearings, axis=1)
        s = np.hypot(x, y)
        for shape in cls.INITIAL_SHAPES:
            zeros = {p.name: 0.0 for p in example.parameters if p.name not in {"fx", "fy", "cx", "cy"}}
            values = zeros | {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0} | shape
            model = cls(**values)
            with np.errstate(all="ignore"):
                g = model.radial_scale(model.projection_values, s, c, MAX_ITERATIONS)
                use = (c > model.projection_values.c_min) & np.isfinite(g)
            if use.sum() < 6 or use.sum() < 0.5 * len(use):
                continue
            # Low weights where it is steep: there the shape, not the focal length, determines the radius.
            weight = 1 / (1 + np.abs(g[use]))
            focal_centre = []
            for plane, pixel in ((g * x, pixels[:, 0]), (g * y, pixels[:, 1])):
                design = np.stack([plane[use], np.ones(use.sum())], -1) * weight[:, None]
                focal_centre.append(np.linalg.lstsq(design, pixel[use] * weight, rcond=None)[0])
            (fx, cx), (fy, cy) = focal_centre
            yield cls(**(values | {"fx": float(fx), "fy": float(fy), "cx": float(cx), "cy": float(cy)}))


def linear_combination(a: float, x: Partial, b: float, y: Partial) -> Partial:
    """Return a x + b y; most affine maps are diagonal."""
    return b * y if a == 0 else a * x if b == 0 else a * x + b * y


def derivative_by_cosine(s: Array, c: Array, g: Array, slope: Array, at_axis: float) -> Array:
    """Return dg/d cos(theta) of g = r(theta)/sin(theta) from the slope dr/dtheta; `at_axis` is its limit at 0."""
    near = s < 1e-4
    s2 = np.where(near, 1.0, s * s)
    return np.where(near & (c > 0), at_axis, -(slope - g * c) / s2)


def divide_by_sine(value: Array, s: Array, c: Array, at_axis: float = 0.0) -> Array:
    """Return value/sin(theta), and its limit on the axis."""
    near = (s < 1e-9) & (c > 0)
    return np.where(near, at_axis, value / np.where(near, 1.0, s))
