"""Rays of pixels through cameras whose parameters bundle adjustment refines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models import CameraModel

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Variances of a calibration below this share of the largest are those of fixed parameters.
MIN_RELATIVE_VARIANCE = 1e-24
# Step of derivatives along tangents by differences, radians, and length of a tangent that has no direction.
STEP, MIN_TANGENT = 1e-5, 1e-12


@dataclass(frozen=True, eq=False)
class FreeCameras:
    """Cameras with the parameters p = p0 + B q.

    Attributes
    ----------
    cameras
        The cameras at q = 0.
    bases
        For each camera its matrix B (P, Q); a row of zeros fixes a parameter.
    precision
        (Q,) inverse variances of q, whose prior mean is zero; 0 without prior.
    """

    cameras: tuple[Camera, ...]
    bases: tuple[Array, ...]
    precision: Array

    @classmethod
    def of_parameters(cls, cameras: Sequence[Camera], sigmas: Sequence[Mapping[tuple[str, ...], float]]) -> Self:
        """Free groups of parameters of each camera; those of a group change together.

        Parameters
        ----------
        cameras
            The cameras.
        sigmas
            For each camera the standard deviation of the prior of each group; infinity without prior.
        """
        bases = [
            np.zeros((len(camera.model.params), len(groups))) for camera, groups in zip(cameras, sigmas, strict=True)
        ]
        for camera, basis, groups in zip(cameras, bases, sigmas, strict=True):
            for column, group in enumerate(groups):
                basis[[camera.model.param_names.index(name) for name in group], column] = 1.0
        return cls.of_bases(cameras, bases, [np.array([1 / s**2 for s in groups.values()], float) for groups in sigmas])

    @classmethod
    def of_calibrations(cls, cameras: Sequence[Camera]) -> Self:
        """Free all parameters of each camera, with the covariance of its calibration as the prior.

        Raises
        ------
        ValueError
            If a camera has no covariance.
        """
        bases = list[Array]()
        for camera in cameras:
            if camera.covariance is None:
                raise ValueError(
                    f"the calibration ({camera.model.name}) has no covariance, and cannot be refined: calibrate with"
                    " omnisight, or estimate the camera from the images (--camera auto)"
                )
            variances, axes = np.linalg.eigh(camera.covariance)
            used = variances > MIN_RELATIVE_VARIANCE * variances[-1]
            bases.append(axes[:, used] * np.sqrt(variances[used]))
        return cls.of_bases(cameras, bases, [np.ones(basis.shape[1]) for basis in bases])

    @classmethod
    def of_bases(cls, cameras: Sequence[Camera], bases: Sequence[Array], precision: Sequence[Array]) -> Self:
        """Free combinations of the parameters of each camera.

        Parameters
        ----------
        cameras
            The cameras.
        bases
            For each camera (P, Q_k).
        precision
            For each camera (Q_k,) inverse variances.
        """
        starts = np.cumsum([0, *(basis.shape[1] for basis in bases)])
        full = [np.zeros((len(basis), starts[-1])) for basis in bases]
        for whole, basis, start in zip(full, bases, starts, strict=False):
            whole[:, start : start + basis.shape[1]] = basis
        return cls(tuple(cameras), tuple(full), np.concatenate([np.zeros(0), *precision]))

    @property
    def count(self) -> int:
        """Number Q of free values."""
        return len(self.precision)

    def at(self, values: Array, covariance: Array | None = None) -> tuple[Camera, ...]:
        """Return the cameras with values (Q,), and with their covariance (Q, Q) if it is known."""
        found: list[Camera] = []
        for camera, basis in zip(self.cameras, self.bases, strict=True):
            model = camera.model.with_params(camera.model.params + basis @ values)
            of_params = None if covariance is None else basis @ covariance @ basis.T
            found.append(replace(camera, model=model, covariance=of_params))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Pixels of free cameras.

    Attributes
    ----------
    free
        The cameras.
    sensor
        (N,) index of the camera of each pixel.
    pixels
        (N, 2).
    whitening
        (N, 2, 2) matrix that makes the errors of the pixel white.
    """

    free: FreeCameras
    sensor: Indices
    pixels: Array
    whitening: Array

    @classmethod
    def of(cls, free: FreeCameras, sensor: Indices, pixels: Array, axes: Array) -> Self:
        """Return pixels whose bearings have the whitened tangents axes (N, 2, 3) at q = 0."""
        whitening = np.empty((len(pixels), 2, 2))
        for k, camera in enumerate(free.cameras):
            use = sensor == k
            whitening[use] = axes[use] @ camera.model.unproject_with_jacobians(pixels[use])[2]
        return cls(free, sensor, pixels, whitening)

    def __getitem__(self, use: Indices) -> Self:
        """Return some of the pixels."""
        return replace(self, sensor=self.sensor[use], pixels=self.pixels[use], whitening=self.whitening[use])

    def at(self, values: Array) -> tuple[Array, Array]:
        """Return bearings (N, 3) and whitened tangents (N, 2, 3); zeros for pixels that the cameras do not see."""
        bearings, axes = np.zeros((len(self.pixels), 3)), np.zeros((len(self.pixels), 2, 3))
        for k, camera in enumerate(self.free.at(values)):
            use = np.flatnonzero(self.sensor == k)
            seen, valid = camera.model.unproject(self.pixels[use])
            use, seen = use[valid], seen[valid]
            bearings[use] = seen
            axes[use] = self.whitening[use] @ camera.model.project_with_jacobians(seen)[2]
        return bearings, axes

    def derivatives(self, values: Array, directions: Array) -> Array:
        """Return the derivatives (N, 2, Q) of the residuals of unit directions (N, 3) by the values."""
        found = np.zeros((len(self.pixels), 2, self.free.count))
        for k, (camera, basis) in enumerate(zip(self.free.at(values), self.free.bases, strict=True)):
            use = np.flatnonzero(self.sensor == k)
            by_params = residual_derivatives(camera.model, self.pixels[use], directions[use])
            found[use] = self.whitening[use] @ by_params @ basis
        return found


def residual_derivatives(model: CameraModel, pixels: Array, directions: Array) -> Array:
    """Return the derivatives (N, 2, P) of the residuals J u of unit directions u by the parameters of a camera.

    J is the derivative of the pixel by the point at the bearing b of the observed pixel, and both depend on the
    parameters. With u = c b + t, where t is tangent, and J b = 0 at all bearings, it is c p + D p + (D J) b', where p
    and b' are the derivatives of the pixel and of the bearing by the parameters, and D is the derivative along t. The
    terms with D are as small as the residual, but those of all observations add up: a larger image has larger
    residuals.

    Parameters
    ----------
    model
        The camera.
    pixels
        (N, 2) observed pixels. The derivatives are zero if the camera does not see them.
    directions
        (N, 3).
    """
    bearings, valid, _, bearings_by_params = model.unproject_with_jacobians(pixels)
    along = (bearings * directions).sum(axis=1, keepdims=True)
    tangents = directions - along * bearings
    length = np.linalg.norm(tangents, axis=1, keepdims=True)
    step = STEP * tangents / np.maximum(length, MIN_TANGENT)
    by_params = model.project_with_jacobians(bearings)[3]
    (_, _, *after), (_, _, *before) = (model.project_with_jacobians(bearings + sign * step) for sign in (1, -1))
    change_of_point, change_of_params = (
        (length / (2 * STEP))[:, :, None] * (b - a) for a, b in zip(before, after, strict=True)
    )
    found = along[:, :, None] * by_params + change_of_params + change_of_point @ bearings_by_params
    return np.where(valid[:, None, None] & np.isfinite(found), found, 0.0)
