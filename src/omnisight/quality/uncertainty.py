"""Projection uncertainty of a calibrated camera, in pixels and as an angle."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import cap, polar
from omnisight.images import ImageField

Array = NDArray[np.float64]

# Grid of directions in which the uncertainty is mapped.
RINGS, SECTORS = 16, 24
# Rings of directions that determine the best rotation.
ROTATION_RINGS = 12
# Largest angle from the axis that is evaluated: the direction opposite to the axis is singular.
MAX_OFF_AXIS_RAD = np.radians(179.0)


@dataclass(frozen=True)
class Uncertainty:
    """Projection uncertainty of a camera, propagated from the covariance of its parameters.

    The pixel of a bearing b is p(b, params), so dp = J dparams. Poses estimated with a camera absorb rotations of its
    frame: a rotation w moves b by w x b. The projection uncertainty at infinity is what remains after the best rotation
    over the calibrated cone (as in mrcal, "Projection uncertainty", Kogan 2020-2024).

    Attributes
    ----------
    camera
        A camera with a covariance.
    reach
        Angle from the axis (radians) up to which directions determine the best rotation.
    """

    camera: Camera
    reach: float

    @classmethod
    def of(cls, camera: Camera) -> Self:
        """Return the uncertainty of a calibrated camera.

        Raises
        ------
        ValueError
            If the camera has no covariance.
        """
        if camera.covariance is None:
            raise ValueError("the camera has no covariance: calibrate it with omnisight to obtain its uncertainty")
        return cls(camera, min(camera.theta_max or camera.model.theta_max, MAX_OFF_AXIS_RAD))

    def projection(self, bearings: Array, *, aligned: bool = True) -> Array:
        """Return the covariance (N, 2, 2), px^2, of the pixels of bearings (N, 3); NaN where there is no pixel.

        Parameters
        ----------
        bearings
            (N, 3) unit, in the camera frame.
        aligned
            Whether the best rotation of the camera frame is removed, as poses estimated with the camera do. Otherwise
            the frame is fixed, as in a camera rigidly mounted to others.
        """
        d_params, d_rotation = self._derivatives(bearings)
        return self._propagate(d_params + d_rotation @ self.best_rotation if aligned else d_params)

    def bearing(self, bearings: Array, *, aligned: bool = True) -> Array:
        """Return the root mean square error (N,), radians, of the bearing of each pixel, see `projection`."""
        covariance = self.projection(bearings, aligned=aligned)
        _, _, d_point, _ = self.camera.model.project_with_jacobians(bearings)
        d_pixel = np.linalg.pinv(np.where(np.isfinite(d_point), d_point, 0.0))  # derivative of the bearing
        return np.sqrt(np.einsum("nij,njk,nik->n", d_pixel, covariance, d_pixel))

    @cached_property
    def best_rotation(self) -> Array:
        """(3, P) best rotation of the camera frame (radians) per unit error of each parameter."""
        bearings = cap(self.reach, ROTATION_RINGS)
        pixels, _ = self.camera.model.project_numpy(bearings)
        bearings = bearings[self.camera.calibrated(bearings) & self.camera.in_image(pixels)]
        d_params, d_rotation = self._derivatives(bearings)
        known = np.isfinite(d_params).all((1, 2))
        d_params, d_rotation = d_params[known], d_rotation[known]
        count = d_params.shape[-1]
        rotation = -np.linalg.lstsq(d_rotation.reshape(-1, 3), d_params.reshape(-1, count), rcond=None)[0]
        return np.asarray(rotation, float)

    def _derivatives(self, bearings: Array) -> tuple[Array, Array]:
        """Return d pixel/d params (N, 2, P) and d pixel/d rotation (N, 2, 3); a rotation w moves b to b + w x b."""
        _, _, d_point, d_params = self.camera.model.project_with_jacobians(bearings)
        return d_params, -d_point @ so3.hat(bearings)

    def _propagate(self, d_params: Array) -> Array:
        assert self.camera.covariance is not None
        return d_params @ self.camera.covariance @ np.swapaxes(d_params, -1, -2)


@dataclass(frozen=True)
class UncertaintyMap(Displayed):
    """`Uncertainty` over angle from the axis and azimuth.

    Attributes
    ----------
    theta, phi
        (A,) and (B,) angle from the axis and azimuth, radians; azimuth 0 is to the right and pi/2 down.
    pixels, angles
        (A, B) root mean square error of the pixel (px) and of the bearing (radians) after the best rotation of the
        frame; NaN where the camera has no pixel.
    fixed_pixels, fixed_angles
        The same with a fixed camera frame.
    visible
        (A, B) whether the direction is inside the image.
    calibrated
        (A,) whether corners were observed at that angle; elsewhere, as in the blind spot of a mirror, the camera
        extrapolates.
    """

    theta: Array
    phi: Array
    pixels: Array
    angles: Array
    fixed_pixels: Array
    fixed_angles: Array
    visible: NDArray[np.bool_]
    calibrated: NDArray[np.bool_]

    @classmethod
    def of(cls, camera: Camera, *, field: ImageField | None = None, rings: int = RINGS, sectors: int = SECTORS) -> Self:
        """Map the calibrated cone and the rest of the image, inside the image field if it is known.

        Raises
        ------
        ValueError
            As `Uncertainty.of`.
        """
        uncertainty = Uncertainty.of(camera)
        cone = uncertainty.reach
        last = min(max(cone, camera.image_theta_max()), camera.model.theta_max, MAX_OFF_AXIS_RAD)
        step = cone / rings
        theta = np.concatenate([step * np.arange(rings + 1), np.arange(cone + step, last + 1e-9, step)])
        phi = 2 * np.pi * np.arange(sectors) / sectors
        bearings = polar(*np.meshgrid(theta, phi, indexing="ij")).reshape(-1, 3)
        pixels, valid = camera.model.project_numpy(bearings)
        shape = len(theta), len(phi)

        def length(aligned: bool) -> Array:
            covariance = uncertainty.projection(bearings, aligned=aligned)
            return np.sqrt(np.trace(covariance, axis1=1, axis2=2)).reshape(shape)

        def angle(aligned: bool) -> Array:
            return uncertainty.bearing(bearings, aligned=aligned).reshape(shape)

        visible = (valid & (camera.in_image(pixels) if field is None else field.contains(pixels))).reshape(shape)
        calibrated = (theta <= cone * (1 + 1e-9)) & (theta >= camera.theta_min)
        return cls(theta, phi, length(True), angle(True), length(False), angle(False), visible, calibrated)

    def worst(self) -> tuple[float, float, float, float]:
        """Return the largest error in the calibrated cone: px, radians, and theta and phi of the former."""
        pixels = np.where(self.visible & self.calibrated[:, None], self.pixels, np.nan)
        if not np.isfinite(pixels).any():
            return np.nan, np.nan, np.nan, np.nan
        i, j = np.unravel_index(np.nanargmax(pixels), pixels.shape)
        angles = np.where(np.isfinite(pixels), self.angles, np.nan)
        return float(pixels[i, j]), float(np.nanmax(angles)), float(self.theta[i]), float(self.phi[j])

    def rms(self) -> float:
        """Return the root mean square error in the calibrated cone, px, weighted by solid angle."""
        return self._rms(self.pixels)

    def rms_angle(self) -> float:
        """Return the root mean square error in the calibrated cone, radians, weighted by solid angle."""
        return self._rms(self.angles)

    def _rms(self, values: Array) -> float:
        inside = self.visible & self.calibrated[:, None] & np.isfinite(self.pixels)
        weight = np.broadcast_to(np.sin(self.theta)[:, None], inside.shape)[inside]
        if not weight.sum() > 0:
            return float("nan")
        return float(np.sqrt(np.average(values[inside] ** 2, weights=weight)))
