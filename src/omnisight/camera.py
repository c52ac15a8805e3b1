"""A camera: a model, the size of its images, and what is known of how it was calibrated."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel

Array = NDArray[np.float64]


class HasImageSize:
    """What has images of one size, in px: (width, height), (0, 0) where that is not known."""

    size: tuple[int, int]

    def __post_init__(self) -> None:
        """Refuse a size that is none."""
        if len(self.size) != 2 or min(self.size) < 0:
            raise ValueError(f"size must be (width, height), got {self.size!r}")

    @property
    def width(self) -> int:
        """Pixels per row."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Rows."""
        return self.size[1]

    def in_image(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Say which pixels (..., 2) lie in the image: in [-0.5, width - 0.5) x [-0.5, height - 0.5)."""
        p = np.asarray(pixels, float)
        with np.errstate(invalid="ignore"):
            return np.all((p >= -0.5) & (p < np.array(self.size) - 0.5), axis=-1)


@dataclass(frozen=True)
class Camera(HasImageSize):
    """A camera model with its image.

    Attributes
    ----------
    model
        Bearings to pixels and back.
    size
        (width, height) of the image, px; (0, 0) where a file does not say.
    theta_max
        The angle from the axis (radians) up to which corners were seen in calibration: past it the model extrapolates.
        None where it is not known.
    theta_min
        The angle from which corners were seen: a mirror shows nothing but its camera in the middle. 0 for a lens.
    calibration
        Figures of the calibration (rms, held_out_rms, views, corners ...), by name.
    covariance
        (P, P) of the parameters, or None.
    provenance
        Where it came from: file, format, tool, date.
    extra
        What its file held beside that, kept for the next writer.
    """

    model: CameraModel
    size: tuple[int, int]
    theta_max: float | None = None
    calibration: Mapping[str, Any] = field(default_factory=dict[str, Any])
    covariance: Array | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    theta_min: float = 0.0

    @property
    def px_unit(self) -> float:
        """What a px of an image 1000 px wide is here, for limits: as much larger as the image is, and no smaller."""
        return max(1.0, max(self.size) / 1000)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3) to pixels (..., 2) and their validity; see `CameraModel.project`."""
        return self.model.project(points)

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Give the bearings (..., 3) of pixels (..., 2) and their validity; see `CameraModel.unproject`."""
        return self.model.unproject(pixels)

    def rays(self, pixels: ArrayLike) -> Rays:
        """Give the rays of pixels (..., 2) in the camera's frame: all from its centre."""
        bearings, valid = self.unproject(pixels)
        return Rays(np.where(valid[..., None], 0.0, bearings), bearings, valid)

    def calibrated(self, bearings: Array) -> NDArray[np.bool_]:
        """Say which directions (..., 3) lie where corners were seen, of as much as is known of that."""
        angle = angle_from_axis(np.asarray(bearings, float))
        with np.errstate(invalid="ignore"):
            return (angle >= self.theta_min) & (angle <= (np.pi if self.theta_max is None else self.theta_max))

    def angle_of(self, pixels: ArrayLike) -> Array:
        """Give the angle from the axis (radians) of pixels (..., 2), NaN where not valid."""
        bearings, _ = self.unproject(pixels)
        return angle_from_axis(bearings)

    def border(self, count: int = 64) -> Array:
        """Give pixels (N, 2) around the image's edge."""
        t = np.linspace(0, 1, count, endpoint=False)
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * (np.array(self.size) - 1.0)
        return np.concatenate([corners[i] + t[:, None] * (corners[i + 1] - corners[i]) for i in range(4)])

    def image_theta_max(self) -> float:
        """Give the largest angle from the axis (radians) that the image's edge shows."""
        angles = angle_from_axis(self.model.unproject_numpy(self.border())[0])
        return float(np.nanmax(angles)) if np.isfinite(angles).any() else self.model.theta_max

    def scaled(self, factor: float) -> "Camera":
        """Give the camera of the image resized by a factor; a pixel centre c goes to (c + 1/2) factor - 1/2."""
        size = (round(self.width * factor), round(self.height * factor))
        return dataclasses.replace(self, model=self.model.rescaled(factor), size=size, covariance=None)

    def samples(self, theta_max: float | None = None, count: int = 41) -> tuple[Array, Array]:
        """Give bearings (N, 3) and their pixels (N, 2) over the image, up to an angle from the axis (radians).

        The angle is the calibrated cone unless told otherwise, or all of the image where that is not known; what lies
        within `theta_min` is left out.
        """
        limit = theta_max or self.theta_max or self.model.theta_max
        u, v = np.meshgrid(np.linspace(0, self.width - 1, count), np.linspace(0, self.height - 1, count))
        pixels = np.stack([u.ravel(), v.ravel()], -1)
        bearings, valid = self.model.unproject_numpy(pixels)
        with np.errstate(invalid="ignore"):
            use = valid & (bearings[:, 2] >= np.cos(limit)) & (bearings[:, 2] <= np.cos(self.theta_min))
        # On the very rim rounding decides; what does not come back is no sample.
        use[use] = self.model.project_numpy(bearings[use])[1]
        return bearings[use], pixels[use]
