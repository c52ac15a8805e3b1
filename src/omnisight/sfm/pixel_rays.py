"""Rays of pixels through cameras whose parameters bundle adjustment refines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


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
        starts = np.cumsum([0, *(len(each) for each in sigmas)])
        bases = [np.zeros((len(camera.model.params), starts[-1])) for camera in cameras]
        for camera, basis, start, groups in zip(cameras, bases, starts, sigmas, strict=False):
            for column, group in enumerate(groups, start):
                basis[[camera.model.param_names.index(name) for name in group], column] = 1.0
        precision = [1 / sigma**2 for groups in sigmas for sigma in groups.values()]
        return cls(tuple(cameras), tuple(bases), np.array(precision, float))

    @property
    def count(self) -> int:
        """Number Q of free values."""
        return len(self.precision)

    def at(self, values: Array, covariance: Array | None = None) -> tuple[Camera, ...]:
        """Return the cameras with values (Q,) whose covariance (Q, Q) may be known."""
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

    def at(self, values: Array) -> tuple[Array, Array, Array]:
        """Return bearings (N, 3), whitened tangents (N, 2, 3), and the derivatives of residuals (N, 2, Q) by values.

        The residual A u of a direction u has the derivative -A db: the tangents turn with the bearing b. A pixel that
        the cameras do not see has the bearing zero.
        """
        bearings, axes = np.zeros((len(self.pixels), 3)), np.zeros((len(self.pixels), 2, 3))
        derivatives = np.zeros((len(self.pixels), 2, self.free.count))
        for k, (camera, basis) in enumerate(zip(self.free.at(values), self.free.bases, strict=True)):
            use = np.flatnonzero(self.sensor == k)
            seen, valid, by_pixel, by_params = camera.model.unproject_with_jacobians(self.pixels[use])
            use, by_pixel = use[valid], by_pixel[valid]
            gram = np.linalg.inv(by_pixel.transpose(0, 2, 1) @ by_pixel)
            bearings[use] = seen[valid]
            axes[use] = self.whitening[use] @ gram @ by_pixel.transpose(0, 2, 1)
            derivatives[use] = -axes[use] @ by_params[valid] @ basis
        return bearings, axes, derivatives
