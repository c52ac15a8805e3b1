"""How well a calibrated camera knows where a direction falls in the image, and where a pixel looks."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import cap, polar
from omnisight.images import ImageField

Array = NDArray[np.float64]

RINGS, SECTORS = 16, 24
# Angles from the axis that are asked about: past this share of the sphere's half nothing is well defined.
LAST = np.radians(179.0)


@dataclass(frozen=True)
class Uncertainty:
    """The uncertainty of a camera's projection, from the covariance of its parameters.

    A direction b falls on the pixel p(b, params): dp = J dparams. A camera is mostly used with poses found through it,
    and these turn with its errors: a turn w of the camera frame moves b by w x b, and what is left of an error when
    the frame has turned to fit best is the error that a far point of the scene shows (mrcal, "How to run a
    calibration: projection uncertainty", Kogan 2020-2024, asks the same). `turn` is that best w for each parameter,
    over the calibrated cone.

    Attributes
    ----------
    camera
        A camera with its covariance.
    reach
        The angle from the axis (radians) up to which directions count in the best turn.
    """

    camera: Camera
    reach: float

    @classmethod
    def of(cls, camera: Camera) -> Self:
        """Ask a camera that was calibrated.

        Raises
        ------
        ValueError
            If the camera does not know its covariance.
        """
        if camera.covariance is None:
            raise ValueError("this camera has no covariance: calibrate it with omnisight to know its uncertainty")
        return cls(camera, min(camera.theta_max or camera.model.theta_max, LAST))

    def projection(self, bearings: Array, *, turned: bool = True) -> Array:
        """Give the covariance (N, 2, 2), px^2, of the pixels that directions (N, 3) fall on; NaN where on none.

        Parameters
        ----------
        bearings
            (N, 3) unit, in the camera frame.
        turned
            Whether the camera frame may turn to fit best: errors that a pose found with the camera takes up do not
            count. Otherwise the frame stands, as in a camera that is bolted to others.
        """
        d_params, d_turn = self._effects(bearings)
        return self._spread(d_params + d_turn @ self.turn if turned else d_params)

    def bearing(self, bearings: Array, *, turned: bool = True) -> Array:
        """Give the standard deviation (N,), radians, of the direction that is taken for the pixel seen along each.

        The root mean square of the angle between the two; see `projection`.
        """
        covariance = self.projection(bearings, turned=turned)
        _, _, d_point, _ = self.camera.model.project_with_jacobians(bearings)
        away = np.linalg.pinv(np.where(np.isfinite(d_point), d_point, 0.0))  # a pixel's shift as a shift of the bearing
        return np.sqrt(np.einsum("nij,njk,nik->n", away, covariance, away))

    @cached_property
    def turn(self) -> Array:
        """The turn (3, P), radians, that the camera frame makes to fit best when a parameter is off by one."""
        bearings = cap(self.reach, 12)
        pixels, _ = self.camera.model.project_numpy(bearings)
        bearings = bearings[self.camera.calibrated(bearings) & self.camera.in_image(pixels)]
        d_params, d_turn = self._effects(bearings)
        known = np.isfinite(d_params).all((1, 2))
        d_params, d_turn = d_params[known], d_turn[known]
        count = d_params.shape[-1]
        turn = -np.linalg.lstsq(d_turn.reshape(-1, 3), d_params.reshape(-1, count), rcond=None)[0]
        return np.asarray(turn, float)

    def _effects(self, bearings: Array) -> tuple[Array, Array]:
        """Give d pixel/d params (N, 2, P), and d pixel/d turn (N, 2, 3): the scene, turned by w, is at b + w x b."""
        _, _, d_point, d_params = self.camera.model.project_with_jacobians(bearings)
        return d_params, -d_point @ so3.hat(bearings)

    def _spread(self, d_params: Array) -> Array:
        assert self.camera.covariance is not None
        return d_params @ self.camera.covariance @ np.swapaxes(d_params, -1, -2)


@dataclass(frozen=True)
class UncertaintyMap:
    """`Uncertainty` over angle from the axis and azimuth.

    Attributes
    ----------
    theta, phi
        (A,) and (B,) the directions, radians: angle from the axis, and azimuth, 0 to the right and pi/2 down.
    pixels, angles
        (A, B) root mean square error of the pixel (px) and of the bearing (radians), the frame turned to fit best;
        NaN where the camera has no pixel.
    fixed_pixels, fixed_angles
        The same with the camera frame as it stands.
    shown
        (A, B) whether the direction falls in the image.
    calibrated
        (A,) whether corners were seen at that angle: beyond, and in the blind middle of a mirror, the camera
        extrapolates.
    """

    theta: Array
    phi: Array
    pixels: Array
    angles: Array
    fixed_pixels: Array
    fixed_angles: Array
    shown: NDArray[np.bool_]
    calibrated: NDArray[np.bool_]

    @classmethod
    def of(cls, camera: Camera, *, field: ImageField | None = None, rings: int = RINGS, sectors: int = SECTORS) -> Self:
        """Map all that the image shows (where `field` says so), the calibrated cone and what lies beyond.

        Raises
        ------
        ValueError
            As `Uncertainty.of`.
        """
        uncertainty = Uncertainty.of(camera)
        cone = uncertainty.reach
        last = min(max(cone, camera.image_theta_max()), camera.model.theta_max, LAST)
        step = cone / rings
        theta = np.concatenate([step * np.arange(rings + 1), np.arange(cone + step, last + 1e-9, step)])
        phi = 2 * np.pi * np.arange(sectors) / sectors
        bearings = polar(*np.meshgrid(theta, phi, indexing="ij")).reshape(-1, 3)
        pixels, valid = camera.model.project_numpy(bearings)
        shape = len(theta), len(phi)

        def length(turned: bool) -> Array:
            covariance = uncertainty.projection(bearings, turned=turned)
            return np.sqrt(np.trace(covariance, axis1=1, axis2=2)).reshape(shape)

        def angle(turned: bool) -> Array:
            return uncertainty.bearing(bearings, turned=turned).reshape(shape)

        shown = (valid & (camera.in_image(pixels) if field is None else field.contains(pixels))).reshape(shape)
        calibrated = (theta <= cone * (1 + 1e-9)) & (theta >= camera.theta_min)
        return cls(theta, phi, length(True), angle(True), length(False), angle(False), shown, calibrated)

    def worst(self) -> tuple[float, float, float, float]:
        """Give the largest error in the calibrated cone: px, radians, and the theta and phi of the first."""
        pixels = np.where(self.shown & self.calibrated[:, None], self.pixels, np.nan)
        if not np.isfinite(pixels).any():
            return np.nan, np.nan, np.nan, np.nan
        i, j = np.unravel_index(np.nanargmax(pixels), pixels.shape)
        angles = np.where(np.isfinite(pixels), self.angles, np.nan)
        return float(pixels[i, j]), float(np.nanmax(angles)), float(self.theta[i]), float(self.phi[j])

    def rms(self) -> float:
        """Give the root mean square error in the calibrated cone, px, each direction by its solid angle."""
        inside = self.shown & self.calibrated[:, None] & np.isfinite(self.pixels)
        weight = np.broadcast_to(np.sin(self.theta)[:, None], inside.shape)[inside]
        if not weight.sum() > 0:
            return float("nan")
        return float(np.sqrt(np.average(self.pixels[inside] ** 2, weights=weight)))

    def median(self) -> tuple[float, float]:
        """Give the median error in the calibrated cone, px and radians, each direction by its solid angle."""
        inside = self.shown & self.calibrated[:, None] & np.isfinite(self.pixels)
        weight = np.broadcast_to(np.sin(self.theta)[:, None], inside.shape)[inside]
        return _median(self.pixels[inside], weight), _median(self.angles[inside], weight)


def _median(values: Array, weight: Array) -> float:
    if not weight.sum() > 0:
        return float("nan")
    order = np.argsort(values)
    along = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(along, along[-1] / 2)])
