"""The protocol of a camera model: what every model gives, and what it inherits."""

import dataclasses
from collections.abc import Iterator, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._elementwise import FULL
from omnisight.models._projector import Array, Projector
from omnisight.models._threads import run


class _KernelType:
    """The named tuple type of a model's kernel, made once per class at first sight.

    numba's cache on disk pickles these types by name, so a class gives its own also before it has an instance.
    """

    made: ClassVar[dict[type["CameraModel"], Any]] = {}

    def __get__(self, _: object, cls: type["CameraModel"]) -> Any:
        if cls not in self.made:
            # numba takes two named tuples of one name and the same fields for one type.
            fields = [(name, Any) for name in cls.example().kernel_values()]
            made: Any = NamedTuple(f"{cls.name}_kernel", fields)  # pyright: ignore[reportArgumentType]
            made.__module__, made.__qualname__ = cls.__module__, f"{cls.__qualname__}.kernel_type"
            made.model = cls
            self.made[cls] = made
        return self.made[cls]


# The radius nearly stops increasing where its slope is below this share of the slope on the axis.
MIN_RELATIVE_GROWTH = 0.05


class CameraModel(Projector):
    """A central camera: bearings to pixels and back.

    A subclass is a frozen dataclass whose fields, in order, are its parameters. It writes two elementwise functions,
    `project_point` and `unproject_pixel`, and their derivatives in `point_jacobian`, and gives `example` and `fit`.
    `valid` means inside the model's one-to-one domain, and nothing else; what is not valid is NaN.
    """

    kernel_type = _KernelType()
    # Greatest off-axis angle (radians) of the corners at which `--model auto` tries the model; 0 for never: views are no
    # lenses, and special cases of a candidate, or models of a hundred parameters, would only cost time.
    auto_max_theta: ClassVar[float] = np.pi

    # -- what a model writes ----------------------------------------------------------------------------------

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, effort: Any) -> Any:
        """Give (u, v, valid) of a point, elementwise; `m` holds the parameters and `derived` by name."""
        raise NotImplementedError

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, effort: Any) -> Any:
        """Give (x, y, z, valid) of a pixel, elementwise: a unit bearing."""
        raise NotImplementedError

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Give pixels (N, 2), valid (N,), d pixel/d point (N, 2, 3) and d pixel/d params (N, 2, P)."""
        raise NotImplementedError

    def derived(self) -> dict[str, Any]:
        """Give the constants that `project_point` needs beside the parameters."""
        return {}

    def derived_back(self) -> dict[str, Any]:
        """Give the constants that only `unproject_pixel` needs."""
        return {}

    @property
    def rim(self) -> float:
        """The angle from the axis (radians) at which the domain ends: `theta_max`, or where the plane folds before."""
        return self.theta_max

    @classmethod
    def starts(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Give rough cameras to refine from, for bearings (N, 3) seen at pixels (N, 2)."""
        raise NotImplementedError

    # -- bearings and pixels ----------------------------------------------------------------------------------

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the camera frame; only their direction matters.

        Parameters
        ----------
        points
            (..., 3), x right, y down, z forward.

        Returns
        -------
        pixels
            (..., 2), NaN where not valid.
        valid
            (...), whether the point lies inside the model's one-to-one domain.

        Raises
        ------
        ValueError
            If the shape is not (..., 3).
        """
        flat, lead = rows(points, 3, "points")
        pixels, valid = np.empty((len(flat), 2)), np.empty(len(flat), np.bool_)
        run("project", (self.name,), self.kernel, flat, pixels, valid, count=len(flat))
        return pixels.reshape(*lead, 2), valid.reshape(lead)

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Give the unit bearings of pixels.

        Parameters
        ----------
        pixels
            (..., 2); integers are pixel centres, the top-left pixel is (0, 0).

        Returns
        -------
        bearings
            (..., 3) unit vectors of the camera frame, NaN where not valid.
        valid
            (...), whether the pixel lies in the image of the model's domain.

        Raises
        ------
        ValueError
            If the shape is not (..., 2).
        """
        flat, lead = rows(pixels, 2, "pixels")
        bearings, valid = np.empty((len(flat), 3)), np.empty(len(flat), np.bool_)
        run("unproject", (self.name,), self.kernel, flat, bearings, valid, count=len(flat))
        return bearings.reshape(*lead, 3), valid.reshape(lead)

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `project`, in plain numpy, for points (N, 3).

        For solvers, which ask many cameras about few points: nothing is compiled or loaded, at ten times the time a
        point.
        """
        with np.errstate(all="ignore"):
            x, y, z = points.T
            u, v, valid = self.project_point(self.forward, x, y, z, FULL)
        pixels = np.empty((len(points), 2))
        pixels[:, 0], pixels[:, 1] = u, v
        valid = valid & (np.abs(pixels[:, 0]) != np.inf)
        if not valid.all():
            pixels[~valid] = np.nan
        return pixels, valid

    def unproject_numpy(self, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Do as `unproject`, in plain numpy, for pixels (N, 2); see `project_numpy`."""
        with np.errstate(all="ignore"):
            u, v = pixels.T
            *bearing, valid = self.unproject_pixel(self.kernel, u, v, FULL)
            valid = np.broadcast_to(valid, len(pixels)) & (np.abs(bearing[0]) != np.inf)
            return np.where(valid[:, None], np.stack(np.broadcast_arrays(*bearing), -1), np.nan), valid

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate.

        Returns
        -------
        pixels, valid
            As `project`.
        d_point
            (..., 2, 3), d pixel / d point. It maps the point itself to zero: scale does not matter.
        d_params
            (..., 2, P), d pixel / d params.
        """
        flat, lead = rows(points, 3, "points")
        with np.errstate(all="ignore"):
            pixels, valid, d_point, d_params = self.derivatives(flat)
        return shaped(lead, pixels, valid, d_point, d_params)

    def unproject_with_jacobians(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Give bearings, their validity, d bearing/d pixel (..., 3, 2) and d bearing/d params (..., 3, P).

        By the implicit function theorem: the first is the pseudo-inverse of d pixel/d point at the unit bearing, the
        second minus that times d pixel/d params.
        """
        bearings, valid = self.unproject(pixels)
        _, _, d_point, d_params = self.project_with_jacobians(bearings)
        gram = d_point @ np.swapaxes(d_point, -1, -2)
        with np.errstate(all="ignore"):
            determinant = gram[..., 0, 0] * gram[..., 1, 1] - gram[..., 0, 1] ** 2
            inverse = np.stack([gram[..., 1, 1], -gram[..., 0, 1], -gram[..., 1, 0], gram[..., 0, 0]], axis=-1).reshape(
                *gram.shape[:-2], 2, 2
            )
            inverse /= determinant[..., None, None]
        d_pixel = np.swapaxes(d_point, -1, -2) @ inverse
        return bearings, valid, d_pixel, -d_pixel @ d_params

    @cached_property
    def kernel(self) -> Any:
        """The parameters and derived constants as the named tuple that compiled code takes."""
        return type(self).kernel_type(**self.kernel_values())

    @cached_property
    def forward(self) -> Any:
        """The parameters, and the constants that projecting alone needs, by name: solvers make many cameras."""
        return SimpleNamespace(**self.__dict__ | self.derived(), model=type(self))

    def kernel_values(self) -> dict[str, Any]:
        """Give the parameters and derived constants by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}  # pyright: ignore[reportArgumentType]
        values = {n: tuple(map(float, v)) if isinstance(v, tuple) else float(v) for n, v in values.items()}
        return values | self.derived() | self.derived_back()

    @classmethod
    def fit(cls, bearings: ArrayLike, pixels: ArrayLike, *, fixed: Sequence[str] = ()) -> Self:
        """Fit the model to bearings and the pixels they are seen at: starts calibrations, converts between models.

        Parameters
        ----------
        bearings
            (N, 3) directions of the camera frame.
        pixels
            (N, 2) where they are seen.
        fixed
            Parameters by name that keep the value of the model's start (0 for a skew).

        Returns
        -------
        The camera of this model with the least squared distance in pixels.
        """
        from omnisight.models._fit import fit

        directions, _ = rows(bearings, 3, "bearings")
        seen, _ = rows(pixels, 2, "pixels")
        return fit(cls, directions, seen, fixed)


def rows(values: ArrayLike, width: int, what: str) -> tuple[Array, tuple[int, ...]]:
    """Give values as contiguous (N, width) float64 and their leading shape, or say which shape came."""
    array = np.asarray(values)
    if array.ndim == 0 or array.shape[-1] != width or array.dtype.kind not in "fiub":
        raise ValueError(
            f"{what} must be real numbers of shape (..., {width}), got shape {array.shape} of {array.dtype}"
        )
    # Writeable: what is not is another type to compiled code, which would be compiled once more for it.
    return np.require(array.reshape(-1, width), np.float64, ["C", "W"]), array.shape[:-1]


def shaped(
    lead: tuple[int, ...], pixels: Array, valid: NDArray[np.bool_], d_point: Array, d_params: Array
) -> tuple[Array, NDArray[np.bool_], Array, Array]:
    """Give a projection of N points and its derivatives in the points' leading shape, NaN where not valid."""
    if not valid.all():
        for array in (pixels, d_point, d_params):
            array[~valid] = np.nan
    return (
        pixels.reshape(*lead, 2),
        valid.reshape(lead),
        d_point.reshape(*lead, 2, 3),
        d_params.reshape(*lead, 2, d_params.shape[-1]),
    )
