"""A camera with an axis whose rays start along it: fisheyes with a moving pupil, mirrors off their focus, spheres."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel, model_class, parameter
from omnisight.models._parameter import finite
from omnisight.models._protocol import rows, shaped
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.optics.ray_model import RayModel

Array = NDArray[np.float64]

# A ray straight backwards meets the axis nowhere, or everywhere: past this angle there are none.
LAST = np.radians(179.0)
# Radians below which theta/sin(theta) - 1 is written as its series.
NEAR = 0.02
# Newton's steps at most, and the last of them that matters (radians): the next would be its square.
STEPS, SETTLED = 6, 1e-9
# Angles that are looked through, where these do not settle, for one where they will, and how often it is halved down.
ANGLES, HALVINGS = 91, 20


@dataclass(frozen=True)
class Axial(RayModel):
    """A central camera for the bearings, and the place on its axis from where each ray starts.

    A lens or a mirror that is the same all around its axis sends every ray through the axis: the ray of a pixel is seen
    along the bearing that `lens` gives, at the angle theta from the axis, and starts at (0, 0, s(theta)) with

        s(theta) = (theta/sin(theta) - 1) (e0 + e1 theta^2 + e2 theta^4 ...)

    (Gennery, Generalized camera calibration including fish-eye lenses, IJCV 68, 2006, where it is the entrance pupil of
    a fisheye; the model is known as CAHVORE). A constant is left out: a camera moved along its axis is the same camera,
    so that s(0) = 0. For mirrors it is as good: what a ray misses the origin by, s sin(theta) = (theta - sin(theta))
    (e0 + ...), is smooth up to 180 degrees, as it is for a sphere, whose rays far out pass the axis at a distance. Two
    coefficients leave 0.1 % of the travel of a sphere, seen to 145 degrees, and 2 % of that of a hyperbola off its
    focus, three a sixth of these or less; polynomials in theta^2 leave up to a hundred times as much of the sphere.

    Valid for points past the place where neighbouring rays cross (the caustic), at positive distance along their ray.

    Attributes
    ----------
    lens
        Any central camera; its theta is the ray's.
    pupil
        (e0, e1 ...), in the unit of the points; all zero for a central camera.
    """

    lens: CameraModel
    pupil: tuple[float, ...] = parameter("of the place on the axis: at theta^0, theta^2 ...", unit="m", default=(0.0,))

    def to_dict(self) -> dict[str, Any]:
        """Give the lens' model as "lens", and the parameters by name."""
        return {"lens": self.lens.name, **super().to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make it from what `to_dict` gives.

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
            raise ValueError(f"model {cls.name}: of {len(pupil)} coefficients none is {', '.join(unknown)}")
        return cls(
            model_class(str(values["lens"])).from_dict(lens),
            tuple(finite(pupil[name], f"{cls.name}.{name}") for name in names),
        )

    # -- the axis ---------------------------------------------------------------------------------------------

    @property
    def theta_max(self) -> float:
        """The angle from the axis (radians) that bounds the valid cone."""
        return min(self.lens.theta_max, LAST) if any(self.pupil) else self.lens.theta_max

    @property
    def fold_angle(self) -> float:
        """The angle (radians) at which the image of its lens folds over."""
        return self.lens.fold_angle

    @property
    def period(self) -> float | None:
        """The width in px after which the image repeats, if it does."""
        return self.lens.period

    def start(self, theta: ArrayLike) -> Array:
        """Give s(theta) (...), the place on the axis from where rays at these angles (radians) start."""
        angles = np.asarray(theta, float)
        return self._start(angles, np.sin(angles), np.cos(angles))[0]

    def travel(self, theta_min: float, theta_max: float) -> float:
        """Give how far the viewpoint moves along the axis between two angles (radians), in the unit of the pupil."""
        return float(np.ptp(self.start(np.linspace(theta_min, min(theta_max, self.theta_max), 181))))

    def _start(self, theta: Array, sine: Array, cosine: Array) -> tuple[Array, Array]:
        """Give s and s'(theta)/sin(theta)."""
        base, slope, per_sine = _stretch(theta, sine, cosine)
        e, along = _polynomial(self.pupil, theta * theta)
        return base * e, slope * e + 2 * base * per_sine * along

    def _seen(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array]:
        """Give the directions (N, 3) in which the lens sees points, whether it does, and their angles (N,).

        The ray at theta passes a point, rho beside the axis and at z along it, by F = rho cos(theta) - (z - s)
        sin(theta). F is not negative on the axis; the ray that is seen is where it falls through zero.
        """
        rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        theta = np.arctan2(rho, z)
        if not any(self.pupil):
            return points, np.ones(len(points), np.bool_), theta
        theta, start, found = self._newton(rho, z, theta)
        if len(rest := np.flatnonzero(~found)):
            theta[rest], start[rest], found[rest] = self._newton(rho[rest], z[rest], self._near(rho[rest], z[rest]))
        return points - start[:, None] * (0.0, 0.0, 1.0), found, theta

    def _newton(self, rho: Array, z: Array, theta: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Give the angles (N,) near others at which F falls through zero, where these rays start, if there are any."""
        start, found = theta, np.isfinite(theta)
        for _ in range(STEPS):
            theta = np.minimum(theta, self.theta_max)
            sine, cosine = np.sin(theta), np.cos(theta)
            start, bend = self._start(theta, sine, cosine)
            along = z - start
            ahead = rho * sine + along * cosine
            slope = bend * sine * sine - ahead
            step = (along * sine - rho * cosine) / slope
            theta, start = theta + step, start + bend * sine * step
            found = (np.abs(step) < SETTLED) & (slope < 0) & (ahead > 0) & (theta <= self.theta_max)
            if found.all():
                break
        return theta, start, found

    def _near(self, rho: Array, z: Array) -> Array:
        """Give angles (N,) near those at which F first falls through zero; NaN where it does not."""
        low = np.full_like(rho, np.nan)
        angles = np.linspace(0, self.theta_max, ANGLES)
        starts, before = self.start(angles), rho
        for k in range(1, ANGLES):
            f = rho * np.cos(angles[k]) - (z - starts[k]) * np.sin(angles[k])
            low = np.where(np.isnan(low) & (before >= 0) & (f < 0), angles[k - 1], low)
            before = f
        high = low + angles[1]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            beside = rho * np.cos(middle) - (z - self.start(middle)) * np.sin(middle)
            low, high = np.where(beside >= 0, middle, low), np.where(beside >= 0, high, middle)
        return low

    # -- rays and pixels --------------------------------------------------------------------------------------

    def rays(self, pixels: ArrayLike) -> Rays:
        """Give the rays of pixels (..., 2): they start on the axis."""
        bearings, valid = self.lens.unproject(pixels)
        theta = angle_from_axis(bearings)
        with np.errstate(invalid="ignore"):
            valid &= theta <= self.theta_max
            bearings = np.where(valid[..., None], bearings, np.nan)
            origins = np.where(valid, self.start(theta), np.nan)[..., None] * (0.0, 0.0, 1.0)
        return Rays(origins, bearings, valid)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3), in the unit of the pupil, to pixels (..., 2) and their validity."""
        flat, lead = rows(points, 3, "points")
        with np.errstate(all="ignore"):
            directions, found, _ = self._seen(flat)
        pixels, valid = self.lens.project(directions)
        valid &= found
        pixels[~valid] = np.nan
        return pixels.reshape(*lead, 2), valid.reshape(lead)

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `project`, in plain numpy, for points (N, 3)."""
        with np.errstate(all="ignore"):
            directions, found, _ = self._seen(points)
        pixels, valid = self.lens.project_numpy(directions)
        return np.where(found[:, None], pixels, np.nan), valid & found

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate, by the implicit function theorem.

        With q = X - s e_z seen by the lens and d = |q|: theta turns with the point and with s, so that
        ds (1 - s' sin(theta)/d) = s' (cos(theta) drho - sin(theta) dz)/d + (ds/de) de.

        Returns
        -------
        pixels, valid
            As `project`.
        d_point, d_params
            (..., 2, 3) and (..., 2, P).
        """
        flat, lead = rows(points, 3, "points")
        with np.errstate(all="ignore"):
            q, found, theta = self._seen(flat)
            pixels, valid, d_q, d_lens = self.lens.project_with_jacobians(q)
            d = np.linalg.norm(q, axis=1)
            x, y, z = (q / d[:, None]).T
            sine, cosine = np.sin(theta), np.cos(theta)
            _, bend = self._start(theta, sine, cosine)
            own = 1 - bend * (x * x + y * y) / d
            gradient = (bend / (d * own))[:, None] * np.stack([x * z, y * z, -(x * x + y * y)], -1)
            d_start = -d_q[:, :, 2]
            base, _, _ = _stretch(theta, sine, cosine)
            by_pupil = (base / own)[:, None] * theta[:, None] ** (2 * np.arange(len(self.pupil)))
            d_point = d_q + d_start[:, :, None] * gradient[:, None, :]
            d_params = np.concatenate([d_lens, d_start[:, :, None] * by_pupil[:, None, :]], -1)
        valid &= found
        return shaped(lead, pixels, valid, d_point, d_params)

    @classmethod
    def example(cls) -> Self:
        """Give a fisheye whose pupil moves by 4 mm on the way to its rim; lengths in metres."""
        return cls(KannalaBrandt.example(), (0.006, 0.0004))


def _stretch(theta: Array, sine: Array, cosine: Array) -> tuple[Array, Array, Array]:
    """Give theta/sin(theta) - 1, its derivative over sin(theta), and theta/sin(theta)."""
    near = theta < NEAR
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
    """Give a polynomial and its derivative by t."""
    value, slope = np.zeros_like(t), np.zeros_like(t)
    for c in reversed(coefficients):
        slope = slope * t + value
        value = value * t + c
    return value, slope
