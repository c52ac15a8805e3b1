"""Cameras: a model, the size of its images, and the results of its calibration."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.array_kinds import like, to_numpy
from omnisight.display import Displayed, named_tuple_text
from omnisight.file_fields import rescaled_fields
from omnisight.geometry.rays import Rays
from omnisight.geometry.sphere import angle_between, angle_from_axis
from omnisight.models import CameraModel, Projector

Array = NDArray[np.float64]
Model = TypeVar("Model", bound=Projector, covariant=True)

# Image width or height above which limits in px scale with the image.
REFERENCE_SIZE_PX = 1000


class FieldOfView(NamedTuple):
    """Field of view of an image, degrees; NaN beyond the domain of the camera model, or without an image size.

    Attributes
    ----------
    horizontal, vertical, diagonal
        Angle between the left and the right edge, the upper and the lower edge, and two opposite corners.
    """

    horizontal: float
    vertical: float
    diagonal: float

    __repr__ = named_tuple_text


@dataclass(frozen=True, eq=False)
class BaseCamera(Displayed, Generic[Model]):
    """The fields and methods that central and non-central cameras share.

    Cameras are equal if they are of one class and all fields are equal.

    Attributes
    ----------
    model
        The camera model.
    size
        (width, height) of the image, px; (0, 0) if unknown.
    theta_max
        Angle from the axis (radians) up to which the calibration had corners; the model extrapolates beyond. None if
        unknown.
    calibration
        Results of the calibration (rms, held_out_rms, views, corners, ...) by name.
    covariance
        (P, P) covariance of the parameters, or None.
    provenance
        Origin of the camera: file, format, tool, date.
    extra
        Further fields of the file the camera was read from; they are written again.
    theta_min
        Angle from the axis (radians) from which the calibration had corners: the camera itself covers the centre of a
        mirror. 0 for a lens.
    """

    model: Model
    size: tuple[int, int]
    theta_max: float | None = None
    calibration: Mapping[str, Any] = field(default_factory=dict[str, Any])
    covariance: Array | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict[str, Any])
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    theta_min: float = 0.0

    def __post_init__(self) -> None:
        """Check the size."""
        if len(self.size) != 2 or min(self.size) < 0:
            raise ValueError(f"size must be (width, height), got {self.size!r}")

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        # The default comparison of dataclasses fails for arrays.
        return all(
            np.array_equal(ours, theirs) if field.name == "covariance" and ours is not None else ours == theirs
            for field in dataclasses.fields(self)
            for ours, theirs in [(getattr(self, field.name), getattr(other, field.name))]
        )

    def __hash__(self) -> int:
        return hash((type(self), self.model, self.size))

    def __repr__(self) -> str:
        """Summarize the camera in one line."""
        parts = [self.model.name, f"{self.width}x{self.height}" if all(self.size) else "size unknown"]
        if self.theta_max is not None:
            parts.append(f"calibrated to {np.degrees(self.theta_max):.0f}° off-axis")
        if isinstance(rms := self.calibration.get("rms"), float):
            parts.append(f"rms {rms:.2g} px")
        return f"{type(self).__name__}({', '.join(parts)})"

    @property
    def width(self) -> int:
        """Pixels per row."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Number of rows."""
        return self.size[1]

    @property
    def px_unit(self) -> float:
        """Scale of limits in px: 1 for images up to 1000 px, proportional to the larger side above."""
        return max(1.0, max(self.size) / REFERENCE_SIZE_PX)

    def in_image(self, pixels: ArrayLike) -> NDArray[np.bool_]:
        """Return which pixels (..., 2) lie in the image: in [-0.5, width - 0.5) x [-0.5, height - 0.5)."""
        p = np.asarray(pixels, float)
        with np.errstate(invalid="ignore"):
            return np.all((p >= -0.5) & (p < np.array(self.size) - 0.5), axis=-1)

    def calibrated(self, bearings: Array) -> NDArray[np.bool_]:
        """Return which directions (..., 3) lie in the calibrated field of view, as far as it is known."""
        angle = angle_from_axis(np.asarray(bearings, float))
        with np.errstate(invalid="ignore"):
            return (angle >= self.theta_min) & (angle <= (np.pi if self.theta_max is None else self.theta_max))

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (..., 3) of the camera frame to pixels (..., 2) and their validity.

        Arrays of other libraries, such as PyTorch tensors, are answered in their kind, without gradients.
        """
        return like(points, *self.model.project(to_numpy(points)))

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays (...) of pixels (..., 2) in the camera frame."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Self:
        """Return the camera of the image resized by a factor; a pixel centre c moves to (c + 1/2) factor - 1/2."""
        size = (round(self.width * factor), round(self.height * factor))
        scale = self.model.rescaling(factor)
        covariance = None if self.covariance is None else self.covariance * np.outer(scale, scale)
        return dataclasses.replace(
            self,
            model=self.model.rescaled(factor),
            size=size,
            covariance=covariance,
            extra=rescaled_fields(self.extra, factor),
        )


@dataclass(frozen=True, eq=False)
class Camera(BaseCamera[CameraModel]):
    """A central camera: a model that maps bearings to pixels and back, and its image.

    The attributes are those of `BaseCamera`: model, size, theta_max, calibration, covariance, provenance, extra,
    theta_min.
    """

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Return the bearings (..., 3) of pixels (..., 2) and their validity; see `CameraModel.unproject`.

        Arrays of other libraries, such as PyTorch tensors, are answered in their kind, without gradients.
        """
        return like(pixels, *self.model.unproject(to_numpy(pixels)))

    @property
    def fov(self) -> "FieldOfView":
        """Field of view in degrees, as in `perspective`: horizontal, vertical and diagonal.

        The angles between opposite edges and corners of the image, through the pixel of the axis, also where the model
        extrapolates beyond `theta_max`. If the axis is outside the image, they are those between two bearings, of edges
        at the row and column nearest to the axis.
        """
        axis, right, bottom = (
            self.model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0],
            self.width - 0.5,
            self.height - 0.5,
        )
        u0, v0 = np.clip(axis, -0.5, [right, bottom])
        ends = [[(-0.5, v0), (right, v0)], [(u0, -0.5), (u0, bottom)], [(-0.5, -0.5), (right, bottom)]]
        bearings, _ = self.model.unproject_numpy(np.reshape(ends, (6, 2)))
        if not all(self.size):
            angles = np.full(3, np.nan)
        elif self.in_image(axis):
            angles = angle_from_axis(bearings).reshape(3, 2).sum(1)
        else:
            angles = angle_between(bearings[::2], bearings[1::2])
        return FieldOfView(*np.degrees(angles).tolist())

    @property
    def K(self) -> Array:
        """Camera matrix (3, 3) of the pinhole camera with the same image near the axis."""
        centre, _, d_point, _ = self.model.project_with_jacobians([0.0, 0.0, 1.0])
        return np.vstack([np.column_stack([d_point[:, :2], centre]), [0.0, 0.0, 1.0]])

    @property
    def focal(self) -> float:
        """Focal length on the axis: px per radian, the mean of both directions."""
        return float(np.mean(np.linalg.norm(self.K[:2, :2], axis=0)))

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays (...) of pixels (..., 2) in the camera frame; all start at the camera centre."""
        bearings, valid = self.unproject(pixels)
        return Rays(np.where(valid[..., None], 0.0, bearings), bearings, valid)

    def angle_of(self, pixels: ArrayLike) -> Array:
        """Return the angle from the axis (radians) of pixels (..., 2), NaN where not valid."""
        bearings, _ = self.unproject(pixels)
        return angle_from_axis(bearings)

    def border(self, count: int = 64) -> Array:
        """Return pixels (4 count, 2) along the edge of the image."""
        t = np.linspace(0, 1, count, endpoint=False)
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * (np.array(self.size) - 1.0)
        return np.concatenate([corners[i] + t[:, None] * (corners[i + 1] - corners[i]) for i in range(4)])

    def image_theta_max(self) -> float:
        """Return the largest angle from the axis (radians) along the edge of the image."""
        angles = angle_from_axis(self.model.unproject_numpy(self.border())[0])
        return float(np.nanmax(angles)) if np.isfinite(angles).any() else self.model.theta_max

    def samples(self, theta_max: float | None = None, count: int = 41) -> tuple[Array, Array]:
        """Return bearings (N, 3) and their pixels (N, 2) on a grid over the image.

        Parameters
        ----------
        theta_max
            Largest angle from the axis, radians; by default that of the calibrated field of view, or of the model.
            Directions within `theta_min` are left out.
        count
            Pixels along each side of the grid.
        """
        limit = theta_max or self.theta_max or self.model.theta_max
        u, v = np.meshgrid(np.linspace(0, self.width - 1, count), np.linspace(0, self.height - 1, count))
        pixels = np.stack([u.ravel(), v.ravel()], -1)
        bearings, valid = self.model.unproject_numpy(pixels)
        with np.errstate(invalid="ignore"):
            use = valid & (bearings[:, 2] >= np.cos(limit)) & (bearings[:, 2] <= np.cos(self.theta_min))
        # At the rim rounding decides whether a bearing is valid; samples must project.
        use[use] = self.model.project_numpy(bearings[use])[1]
        return bearings[use], pixels[use]
