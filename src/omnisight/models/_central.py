"""A central camera with an axis: a profile r(theta), a distortion of the plane, an affine map to pixels."""

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from omnisight.models._elementwise import FULL, distort, gain, undistort, ungain, where
from omnisight.models._planar import Undistorted, first_positive_root, positive_roots
from omnisight.models._projector import Array, NearFold, Partial
from omnisight.models._protocol import MIN_RELATIVE_GROWTH, CameraModel


class Central(Undistorted, CameraModel):
    """The base of all cameras that are r(theta), then a planar map, then K.

    The profile is written as its gain g = r(theta)/sin(theta), elementwise from s = sin(theta) = rho/n and
    c = cos(theta) = z/n, so that the point of the plane is g (x, y)/n: no trigonometry where the model has none, and
    nothing singular on the axis. A model writes `gain`, its inverse `ungain`, and `gain_derivatives`.
    """

    SHAPES: ClassVar[tuple[dict[str, Any], ...]] = ({},)

    @staticmethod
    def gain(m: Any, s: Any, c: Any, effort: Any) -> Any:
        """Give r(theta)/sin(theta)."""
        raise NotImplementedError

    @staticmethod
    def ungain(m: Any, r: Any, r2: Any, effort: Any) -> Any:
        """Give (sin(theta)/r, cos(theta)) from the radius."""
        raise NotImplementedError

    def gain_derivatives(self, s: Array, c: Array, g: Array) -> tuple[Array, dict[str, Array]]:
        """Give dg/d cos(theta) along the sphere, and dg/d parameter by field: (N,), or (K, N) of a tuple of K."""
        raise NotImplementedError

    # -- the affine map; a model with another one (a stretch matrix) overrides these two ------------------------

    def affine(self) -> tuple[float, float, float, float, float, float]:
        """Give (a11, a12, a21, a22, u0, v0): pixel = A plane + centre."""
        m: Any = self
        return m.fx, getattr(m, "skew", 0.0), 0.0, m.fy, m.cx, m.cy

    def affine_partials(self, x: Array, y: Array) -> dict[str, tuple[Partial, Partial]]:
        """Give the derivatives of the pixel by the parameters of the affine map."""
        return {"fx": (x, 0.0), "fy": (0.0, y), "skew": (y, 0.0), "cx": (1.0, 0.0), "cy": (0.0, 1.0)}

    # -- how the image grows outwards; a profile in which that is a polynomial of the angle overrides these two --

    def growth(self) -> list[float]:
        """Give what has the sign of the radius' slope, as a polynomial: coefficients from 1 up.

        Each is linear in every single parameter.
        """
        return [1.0]

    def growth_angle(self, x: float) -> float:
        """Give the angle (radians) that a value of the polynomial's variable, the plane's r^2, stands for."""
        if (r := x**0.5) >= self.radius_max():
            return self.theta_max
        h, c = self.ungain(self.kernel, r, x, FULL)
        return float(np.arctan2(h * r, c))

    @cached_property
    def near_folds(self) -> list[NearFold]:
        terms = self.growth()
        slope = [i * term for i, term in enumerate(terms)][1:]
        found: list[NearFold] = []
        if all(term >= 0 for term in slope):
            return found
        for x in positive_roots(slope):
            growth = float(polyval(x, terms)) / terms[0]
            if 0 < growth < MIN_RELATIVE_GROWTH and polyval(x, polyder(slope)) > 0 and x < first_positive_root(terms):
                moved = [self.with_params(self.params + one).growth() for one in np.eye(self.params.size)]
                by_params = np.array(moved) - terms
                by_params = (polyval(x, by_params.T) - growth * by_params[:, 0]) / terms[0]
                found.append(NearFold(self.growth_angle(x), growth, by_params))
        return found

    # -- the protocol -----------------------------------------------------------------------------------------

    def derived(self) -> dict[str, Any]:
        c_min, radius_max = self._rim
        affine = dict(zip(("a11", "a12", "a21", "a22", "u0", "v0"), self.affine(), strict=True))
        return {"c_min": c_min, "r2_max": radius_max**2, **affine}

    @cached_property
    def _rim(self) -> tuple[float, float]:
        """Of the valid cone: the cosine of its angle, and the radius of the plane."""
        theta_max = self.theta_max
        return -1.0 if theta_max >= np.pi else float(np.cos(theta_max)), min(self.disc, self.radius_max())

    def derived_back(self) -> dict[str, Any]:
        a11, a12, a21, a22, _, _ = self.affine()
        determinant = a11 * a22 - a12 * a21
        c_min, radius_max = self._rim
        return {
            # What was projected from the very rim must come back, rounded as it is.
            "c_back": c_min - 1e-9,
            "r2_back": radius_max**2 * (1 + 1e-9),
            "b11": a22 / determinant if determinant else np.nan,
            "b12": -a12 / determinant if determinant else np.nan,
            "b21": -a21 / determinant if determinant else np.nan,
            "b22": a11 / determinant if determinant else np.nan,
        }

    @property
    def rim(self) -> float:
        low, high = 0.0, self.theta_max
        _, radius_max = self._rim
        if self.disc >= self.radius_max() < np.inf:
            return high
        # Where the radius first exceeds the disc's, sought ever more closely.
        for _ in range(5):
            theta = np.linspace(low, high, 33)
            with np.errstate(all="ignore"):
                radius = np.sin(theta) * self.gain(self.forward, np.sin(theta), np.cos(theta), FULL)
            past = np.flatnonzero(~(radius <= radius_max))
            if not len(past):
                return high
            low, high = float(theta[max(past[0] - 1, 0)]), float(theta[past[0]])
        return low

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, effort: Any) -> Any:
        rho2 = x * x + y * y
        inverse_n = 1.0 / np.sqrt(rho2 + z * z)
        c = z * inverse_n
        g = gain(m, np.sqrt(rho2) * inverse_n, c, effort) * inverse_n
        px, py = g * x, g * y
        valid = (c > m.c_min) & (px * px + py * py <= m.r2_max)
        px, py = distort(m, px, py)
        u = m.a11 * px + m.a12 * py + m.u0
        return where(g < np.inf, u, g), m.a21 * px + m.a22 * py + m.v0, valid

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, effort: Any) -> Any:
        du, dv = u - m.u0, v - m.v0
        px, py, converged = undistort(m, m.b11 * du + m.b12 * dv, m.b21 * du + m.b22 * dv, effort)
        r2 = px * px + py * py
        h, c = ungain(m, np.sqrt(r2), r2, effort)
        valid = converged & (r2 <= m.r2_back) & (c > m.c_back)
        return where(converged & (np.abs(h) != np.inf), h * px, np.inf), h * py, c, valid

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        x, y, c = points.T.copy()
        over_n = 1.0 / np.sqrt(x * x + y * y + c * c)
        x, y, c = x * over_n, y * over_n, c * over_n
        s = np.sqrt(x * x + y * y)
        g = self.gain(self.forward, s, c, FULL)
        px, py = g * x, g * y
        qx, qy = self.distort(self.forward, px, py)
        a11, a12, a21, a22, u0, v0 = self.affine()
        pixels = np.empty((len(points), 2))
        pixels[:, 0], pixels[:, 1] = a11 * qx + a12 * qy + u0, a21 * qx + a22 * qy + v0
        valid = (c > self.forward.c_min) & (px * px + py * py <= self.forward.r2_max)
        # With p = g(c) b_xy:  dp/db_xy = g (I - b_xy b^T) and dc/dpoint = (e_z - c b)/n.
        xx, xy, yx, yy = self.distort_jacobian(self.forward, px, py)
        dg_dc, dg_dparams = self.gain_derivatives(s, c, g)
        g_n, dg_n = g * over_n, dg_dc * over_n
        back_n = g_n + dg_n * c
        # All points' derivatives by one number lie side by side: they are made so, and read so.
        by_point, along = np.empty((3, 2, len(points))), list[Array]()  # d pixel / d g
        for axis, (jx, jy) in enumerate(
            ((a11 * xx + a12 * yx, a11 * xy + a12 * yy), (a21 * xx + a22 * yx, a21 * xy + a22 * yy))
        ):
            along.append(jx * x + jy * y)
            inwards = -back_n * along[axis]
            by_point[0, axis] = g_n * jx + inwards * x
            by_point[1, axis] = g_n * jy + inwards * y
            by_point[2, axis] = dg_n * along[axis] + inwards * c

        partials = self.affine_partials(qx, qy)
        for name, (dx, dy) in self.distort_partials(px, py).items():
            partials[name] = mixed(a11, dx, a12, dy), mixed(a21, dx, a22, dy)
        for name, dg in dg_dparams.items():
            partials[name] = (dg * along[0], dg * along[1])
        by_params = np.empty((self.params.size, 2, len(points)))
        start = 0
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, field.name)
            stop = start + (len(value) if isinstance(value, tuple) else 1)
            for axis, d in enumerate(partials[field.name]):
                by_params[start:stop, axis] = d
            start = stop
        return pixels, valid, by_point.T, by_params.T

    @classmethod
    def starts(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """For each shape of `SHAPES`, the affine map that fits best (linear least squares)."""
        example = cls.example()
        x, y, c = bearings.T / np.linalg.norm(bearings, axis=1)
        s = np.hypot(x, y)
        for shape in cls.SHAPES:
            zeros = {p.name: 0.0 for p in example.parameters if p.name not in {"fx", "fy", "cx", "cy"}}
            values = zeros | {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0} | shape
            model = cls(**values)
            with np.errstate(all="ignore"):
                g = model.gain(model.forward, s, c, FULL)
                use = (c > model.forward.c_min) & np.isfinite(g)
            if use.sum() < 6 or use.sum() < 0.5 * len(use):
                continue
            # Weighted down where the gain is steep: there the shape, not the focal length, decides.
            weight = 1 / (1 + np.abs(g[use]))
            focal_centre = []
            for plane, seen in ((g * x, pixels[:, 0]), (g * y, pixels[:, 1])):
                design = np.stack([plane[use], np.ones(use.sum())], -1) * weight[:, None]
                focal_centre.append(np.linalg.lstsq(design, seen[use] * weight, rcond=None)[0])
            (fx, cx), (fy, cy) = focal_centre
            yield cls(**(values | {"fx": float(fx), "fy": float(fy), "cx": float(cx), "cy": float(cy)}))


def mixed(a: float, x: Partial, b: float, y: Partial) -> Partial:
    """Give a x + b y; most affine maps are diagonal."""
    return b * y if a == 0 else a * x if b == 0 else a * x + b * y


def along_the_sphere(s: Array, c: Array, g: Array, slope: Array, at_axis: float) -> Array:
    """Give dg/dc of g = r(theta)/sin(theta) from the slope dr/dtheta; `at_axis` is its limit at theta = 0."""
    near = s < 1e-4
    s2 = np.where(near, 1.0, s * s)
    return np.where(near & (c > 0), at_axis, -(slope - g * c) / s2)


def per_sine(value: Array, s: Array, c: Array, at_axis: float = 0.0) -> Array:
    """Give value/sin(theta), with its limit on the axis."""
    near = (s < 1e-9) & (c > 0)
    return np.where(near, at_axis, value / np.where(near, 1.0, s))
