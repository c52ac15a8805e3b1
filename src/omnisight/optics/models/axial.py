"""The axial camera model: rays start along the optical axis, as for fisheyes with entrance pupil shift and mirrors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class, parameter
from omnisight.models._arrays import as_rows, with_leading_shape
from omnisight.models._parameter import finite
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.ray_model import RayModel

Array = NDArray[np.float64]

# A ray at 180 degrees coincides with the axis, so the start point is undefined there.
MAX_OFF_AXIS_RAD = np.radians(179.0)
# Below this angle theta/sin(theta) - 1 uses its series, which does not cancel.
SERIES_LIMIT_RAD = 0.02
# Newton iterations, and the last step that needs no further one (convergence is quadratic).
MAX_NEWTON_STEPS, STEP_TOLERANCE_RAD = 6, 1e-9
# If Newton fails: samples of theta that bracket the root, and bisections of the bracket.
BRACKET_SAMPLES, BISECTIONS = 91, 20


@dataclass(frozen=True)
class Axial(RayModel):
    """A central camera for the bearings, plus the start point of each ray on the optical axis.

    All rays of a rotationally symmetric lens or mirror meet the axis. The ray of a pixel has the bearing given by
    `lens`, at the angle theta from the axis, and starts at (0, 0, s(theta)) with

        s(theta) = (theta/sin(theta) - 1) (e0 + e1 theta^2 + e2 theta^4 ...)

    (Gennery, Generalized camera calibration including fish-eye lenses, IJCV 68, 2006: the entrance pupil shift of a
    fisheye; the model is known as CAHVORE). There is no constant term, because a translation along the axis is part of
    the pose: s(0) = 0. The model also suits mirrors: the distance of a ray from the origin, s sin(theta) = (theta -
    sin(theta)) (e0 + ...), is smooth up to 180 degrees. Residual with two coefficients: 0.1 % of the shift of a sphere
    up to 145 degrees, 2 % of that of a hyperbola off its focus. A third coefficient divides it by 6 or more.
    Polynomials in theta^2 leave up to 100 times as much for the sphere.

    Valid for points beyond the caustic (where neighbouring rays cross) at positive distance along their ray.

    Attributes
    ----------
    lens
        Any central camera model.
    pupil
        (e0, e1 ...), in the unit of the points; all zero for a central camera.
    """

    lens: CameraModel
    pupil: tuple[float, ...] = parameter(
        "coefficients of the entrance pupil shift, of theta^0, theta^2 ...", unit="m", default=(0.0,)
    )

    def to_dict(self) -> dict[str, Any]:
        """Return the name of the lens model as "lens", and the parameters by name."""
        return {"lens": self.lens.name, **super().to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make it from the result of `to_dict`.

        Raises
        ------
        ValueError
            If a name is missing or unknown, or a value is no finite number.
        """
        if "lens" not in values:
            raise ValueError(f"model {cls.name}: missing lens, the name of a camera model")
        pupil = {name: value for name, value in values.items() if name.startswith("pupil")}
        lens = {name: value for name, value in values.items() if name != "lens" and name not in pupil}
        if not pupil:
            raise ValueError(f"model {cls.name}: missing pupil0")
        names = cls.coefficient_names(len(pupil), "pupil")
        if unknown := sorted(set(pupil) - set(names)):
            raise ValueError(f"model {cls.name}: unknown {', '.join(unknown)}; expected {', '.join(names)}")
        return cls(
            model_class(str(values["lens"])).from_dict(lens),
            tuple(finite(pupil[name], f"{cls.name}.{name}") for name in names),
        )

    # -- the start points on the axis -------------------------------------------------------------------------

    @property
    def theta_max(self) -> float:
        """The angle from the axis (radians) that bounds the valid cone."""
        return min(self.lens.theta_max, MAX_OFF_AXIS_RAD) if any(self.pupil) else self.lens.theta_max

    @property
    def fold_angle(self) -> float:
        """The angle (radians) beyond which the projection of the lens is not injective."""
        return self.lens.fold_angle

    @property
    def period(self) -> float | None:
        """The width in px after which the image repeats, if it does."""
        return self.lens.period

    def pupil_z(self, theta: ArrayLike) -> Array:
        """Return s(theta) (...): z of the start point of rays at angles (...) from the axis, radians."""
        angles = np.asarray(theta, float)
        return self._pupil_z(angles, np.sin(angles), np.cos(angles))[0]

    def pupil_shift(self, theta_min: float, theta_max: float) -> float:
        """Return the length of axis covered by start points between two angles (radians), in the unit of `pupil`."""
        return float(np.ptp(self.pupil_z(np.linspace(theta_min, min(theta_max, self.theta_max), 181))))

    def _pupil_z(self, theta: Array, sine: Array, cosine: Array) -> tuple[Array, Array]:
        """Return s and s'(theta)/sin(theta)."""
        base, slope, per_sine = _basis(theta, sine, cosine)
        e, d_e = _polynomial(self.pupil, theta * theta)
        return base * e, slope * e + 2 * base * per_sine * d_e

    def _directions(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Return the directions (N, 3) from start point to point, whether they exist, and their angles (N,).

        The signed distance of the ray at theta from the point (rho, z) is F = rho cos(theta) - (z - s) sin(theta). F >=
        0 at theta = 0; the ray of the point is the first zero crossing.
        """
        rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        theta = np.arctan2(rho, z)
        if not any(self.pupil):
            return points, np.ones(len(points), np.bool_), theta
        theta, start, valid = self._newton(rho, z, theta)
        if len(rest := np.flatnonzero(~valid)):
            theta[rest], start[rest], valid[rest] = self._newton(rho[rest], z[rest], self._bracket(rho[rest], z[rest]))
        return points - start[:, None] * (0.0, 0.0, 1.0), valid, theta

    def _newton(self, rho: Array, z: Array, theta: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the zero crossings of F near angles (N,), the start points of these rays, and convergence."""
        start, valid = theta, np.isfinite(theta)
        for _ in range(MAX_NEWTON_STEPS):
            theta = np.minimum(theta, self.theta_max)
            sine, cosine = np.sin(theta), np.cos(theta)
            start, d_start = self._pupil_z(theta, sine, cosine)
            along = z - start
            ahead = rho * sine + along * cosine
            slope = d_start * sine * sine - ahead
            step = (along * sine - rho * cosine) / slope
            theta, start = theta + step, start + d_start * sine * step
            valid = (np.abs(step) < STEP_TOLERANCE_RAD) & (slope < 0) & (ahead > 0) & (theta <= self.theta_max)
            if valid.all():
                break
        return theta, start, valid

    def _bracket(self, rho: Array, z: Array) -> Array:
        """Return angles (N,) just below the first zero crossing of F by bisection; NaN if there is none."""
        low = np.full_like(rho, np.nan)
        angles = np.linspace(0, self.theta_max, BRACKET_SAMPLES)
        starts, previous = self.pupil_z(angles), rho
        for k in range(1, BRACKET_SAMPLES):
            f = rho * np.cos(angles[k]) - (z - starts[k]) * np.sin(angles[k])
            low = np.where(np.isnan(low) & (previous >= 0) & (f < 0), angles[k - 1], low)
            previous = f
        high = low + angles[1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            f = rho * np.cos(middle) - (z - self.pupil_z(middle)) * np.sin(middle)
            low, high = np.where(f >= 0, middle, low), np.where(f >= 0, high, middle)
        return low

    # -- rays and pixels --------------------------------------------------------------------------------------

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (..., 2); they start on the axis."""
        bearings, valid = self.lens.unproject(pixels)
        theta = angle_from_axis(bearings)
        with np.errstate(invalid="ignore"):
            valid &= theta <= self.theta_max
            bearings = np.where(valid[..., None], bearings, np.nan)
            origins = np.where(valid, self.pupil_z(theta), np.nan)[..., None] * (0.0, 0.0, 1.0)
        return Rays(origins, bearings, valid)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3), in the unit of `pupil`, to pixels (..., 2) and their validity (...)."""
        flat, lead = as_rows(points, 3, "points")
        with np.errstate(all="ignore"):
            directions, exists, _ = self._directions(flat)
        pixels, valid = self.lens.project(directions)
        valid &= exists
        pixels[~valid] = np.nan
        return pixels.reshape(*lead, 2), valid.reshape(lead)

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) in plain NumPy."""
        with np.errstate(all="ignore"):
            directions, exists, _ = self._directions(points)
        pixels, valid = self.lens.project_numpy(directions)
        return np.where(exists[:, None], pixels, np.nan), valid & exists

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate by the implicit function theorem.

        With q = X - s e_z and d = |q|, theta depends on the point and on s:
        ds (1 - s' sin(theta)/d) = s' (cos(theta) drho - sin(theta) dz)/d + (ds/de) de.

        Returns
        -------
        pixels, valid
            As `project`.
        d_point, d_params
            (..., 2, 3) and (..., 2, P).
        """
        flat, lead = as_rows(points, 3, "points")
        with np.errstate(all="ignore"):
            q, exists, theta = self._directions(flat)
            pixels, valid, d_q, d_lens = self.lens.project_with_jacobians(q)
            d = np.linalg.norm(q, axis=1)
            x, y, z = (q / d[:, None]).T
            sine, cosine = np.sin(theta), np.cos(theta)
            _, slope = self._pupil_z(theta, sine, cosine)
            implicit = 1 - slope * (x * x + y * y) / d
            gradient = (slope / (d * implicit))[:, None] * np.stack([x * z, y * z, -(x * x + y * y)], -1)
            d_start = -d_q[:, :, 2]
            base, _, _ = _basis(theta, sine, cosine)
            by_pupil = (base / implicit)[:, None] * theta[:, None] ** (2 * np.arange(len(self.pupil)))
            d_point = d_q + d_start[:, :, None] * gradient[:, None, :]
            d_params = np.concatenate([d_lens, d_start[:, :, None] * by_pupil[:, None, :]], -1)
        valid &= exists
        return with_leading_shape(lead, pixels, valid, d_point, d_params)

    @classmethod
    def example(cls) -> Self:
        """Return a fisheye with an entrance pupil shift of 4 mm; lengths in metres."""
        return cls(KannalaBrandt.example(), (0.006, 0.0004))


def _basis(theta: Array, sine: Array, cosine: Array) -> tuple[Array, Array, Array]:
    """Return theta/sin(theta) - 1, its derivative over sin(theta), and theta/sin(theta)."""
    near = theta < SERIES_LIMIT_RAD
    sine = np.where(near, 1.0, sine)
    per_sine = theta / sine
    slope = (1 - per_sine * cosine) / (sine * sine)
    base = per_sine - 1
    if near.any():
        t2 = theta * theta
        base = np.where(near, t2 * (1 / 6 + t2 * (7 / 360 + t2 * 31 / 15120)), base)
        per_sine = np.where(near, 1 + base, per_sine)
        slope = np.where(near, (1 / 3 + t2 * (7 / 90 + t2 * 31 / 2520)) * per_sine, slope)
    return base, slope, per_sine


def _polynomial(coefficients: tuple[float, ...], t: Array) -> tuple[Array, Array]:
    """Return a polynomial and its derivative by t."""
    value, slope = np.zeros_like(t), np.zeros_like(t)
    for c in reversed(coefficients):
        slope = slope * t + value
        value = value * t + c
    return value, slope
