"""The base of central camera models: bearings to pixels and back."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._arrays import as_rows, with_leading_shape
from omnisight.models._elementwise import MAX_ITERATIONS
from omnisight.models._fit import fit_model
from omnisight.models._projector import Array, Projector
from omnisight.models._run_compiled import run_compiled


class _KernelType:
    """The named tuple type of a model's parameters in compiled code, created once per class.

    numba's cache on disk pickles these types by name, so the type must exist before the first instance.
    """

    types: ClassVar[dict[type["CameraModel"], Any]] = {}

    def __get__(self, _: object, cls: type["CameraModel"]) -> Any:
        if cls not in self.types:
            # numba does not distinguish two named tuples with the same name and fields.
            fields = [(name, Any) for name in cls.example().kernel_values()]
            kernel: Any = NamedTuple(f"{cls.name}_kernel", fields)  # pyright: ignore[reportArgumentType]
            kernel.__module__, kernel.__qualname__ = cls.__module__, f"{cls.__qualname__}.kernel_type"
            kernel.model = cls
            self.types[cls] = kernel
        return self.types[cls]


# Fits a variant of a model: (bearings (N, 3), pixels (N, 2), fixed=names) -> model.
VariantFit = Callable[..., "CameraModel"]


class CameraModel(Projector):
    """A central camera model: the base of all models of this package.

    A subclass is a frozen dataclass whose fields, in order, are its parameters. It implements the two elementwise
    formulas `project_point` and `unproject_pixel`, the derivatives in `derivatives`, `example`, and `initial_models`
    for `fit`. Only the direction of a point matters.
    """

    kernel_type = _KernelType()

    # Off-axis angle (radians) of the outermost corner below which automatic model selection tries the model: special
    # cases of another model, and views that no lens has, set 0.
    auto_max_theta: ClassVar[float] = np.pi
    # Whether the search for the initial camera samples the model: few parameters, one minimum per field of view.
    in_initial_search: ClassVar[bool] = False
    # Whether what corners near the axis would determine is open without them (mirrors): starts then also extrapolate.
    needs_axis: ClassVar[bool] = False
    # Newton steps before the last two if code cannot stop when all points have converged: enough up to 99 % of the rim.
    unrolled_steps: ClassVar[int] = 12

    # -- implemented by each model ----------------------------------------------------------------------------

    @staticmethod
    def project_point(m: Any, x: Any, y: Any, z: Any, max_iterations: Any) -> Any:
        """Return (u, v, valid) of a point, elementwise; `m` holds the parameters and `projection_constants`."""
        raise NotImplementedError

    @staticmethod
    def unproject_pixel(m: Any, u: Any, v: Any, max_iterations: Any) -> Any:
        """Return (x, y, z, valid), the unit bearing of a pixel, elementwise."""
        raise NotImplementedError

    def derivatives(self, points: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Return pixels (N, 2), valid (N,), d pixel/d point (N, 2, 3) and d pixel/d params (N, 2, P)."""
        raise NotImplementedError

    @classmethod
    def derived(cls, m: Any) -> dict[str, Any]:
        """Return functions of the parameters, by name, that the formulas need too.

        They are elementwise formulas like these: results depend on the parameters through them. `m` is a model, or
        has the fields of one; a tuple field may be a tensor.
        """
        return {}

    def projection_constants(self) -> dict[str, Any]:
        """Return the numbers that `project_point` needs besides: limits of its domain and starts of iterations.

        Derivatives do not pass through them.
        """
        return {}

    def unprojection_constants(self) -> dict[str, Any]:
        """Return those that only `unproject_pixel` needs."""
        return {}

    @property
    def rim(self) -> float:
        return self.theta_max

    @classmethod
    def initial_models(cls, bearings: Array, pixels: Array) -> Iterator[Self]:
        """Return rough models from which `fit` starts, for bearings (N, 3) and their pixels (N, 2)."""
        raise NotImplementedError

    @classmethod
    def variants(cls, corners: int) -> Mapping[str, VariantFit]:
        """Return the fits of the variants that a calibration of so many corners compares, by label, simplest first."""
        return {cls.name: cls.fit}

    # -- bearings and pixels ----------------------------------------------------------------------------------

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        flat, lead = as_rows(points, 3, "points")
        pixels, valid = np.empty((len(flat), 2)), np.empty(len(flat), np.bool_)
        run_compiled("project", (self.name,), self.kernel, flat, pixels, valid, count=len(flat))
        return pixels.reshape(*lead, 2), valid.reshape(lead)

    def unproject(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Return the unit bearings of pixels.

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
        flat, lead = as_rows(pixels, 2, "pixels")
        bearings, valid = np.empty((len(flat), 3)), np.empty(len(flat), np.bool_)
        run_compiled("unproject", (self.name,), self.kernel, flat, bearings, valid, count=len(flat))
        return bearings.reshape(*lead, 3), valid.reshape(lead)

    def project_numpy(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Project points (N, 3) in plain numpy, at ten times the time per point; see `Projector.project_numpy`."""
        with np.errstate(all="ignore"):
            x, y, z = points.T
            u, v, valid = self.project_point(self.projection_values, x, y, z, MAX_ITERATIONS)
        pixels = np.empty((len(points), 2))
        pixels[:, 0], pixels[:, 1] = u, v
        valid = valid & (np.abs(pixels[:, 0]) != np.inf)
        if not valid.all():
            pixels[~valid] = np.nan
        return pixels, valid

    def unproject_numpy(self, pixels: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Unproject pixels (N, 2) in plain numpy; see `project_numpy`."""
        with np.errstate(all="ignore"):
            u, v = pixels.T
            *bearing, valid = self.unproject_pixel(self.kernel, u, v, MAX_ITERATIONS)
            valid = np.broadcast_to(valid, len(pixels)) & (np.abs(bearing[0]) != np.inf)
            return np.where(valid[:, None], np.stack(np.broadcast_arrays(*bearing), -1), np.nan), valid

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        flat, lead = as_rows(points, 3, "points")
        with np.errstate(all="ignore"):
            pixels, valid, d_point, d_params = self.derivatives(flat)
        return with_leading_shape(lead, pixels, valid, d_point, d_params)

    def unproject_with_jacobians(self, pixels: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Return bearings, their validity, d bearing/d pixel (..., 3, 2) and d bearing/d params (..., 3, P).

        By the implicit function theorem, d bearing/d pixel is the pseudo-inverse of d pixel/d point at the unit
        bearing, and d bearing/d params is minus its product with d pixel/d params.
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
        """The parameters and constants as the named tuple that compiled code takes."""
        return type(self).kernel_type(**self.kernel_values())

    @cached_property
    def projection_values(self) -> Any:
        """Parameters and the constants of projection alone, by name: solvers create many cameras that only project."""
        return SimpleNamespace(**self.__dict__ | self.derived(self) | self.projection_constants(), model=type(self))

    def kernel_values(self) -> dict[str, Any]:
        """Return the parameters and constants by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}  # pyright: ignore[reportArgumentType]
        values = {n: tuple(map(float, v)) if isinstance(v, tuple) else float(v) for n, v in values.items()}
        return values | self.derived(self) | self.projection_constants() | self.unprojection_constants()

    @classmethod
    def fit(cls, bearings: ArrayLike, pixels: ArrayLike, *, fixed: Sequence[str] = ()) -> Self:
        """Fit the model to bearings and their pixels.

        Parameters
        ----------
        bearings
            (N, 3) directions in the camera frame.
        pixels
            (N, 2) their pixels.
        fixed
            Names of parameters that keep the value of the initial model (0 for a skew).

        Returns
        -------
        The model with the smallest sum of squared distances in pixels.

        Raises
        ------
        ValueError
            If there are fewer than 4 pairs, or the model cannot represent bearings so far off-axis.
        """
        directions, _ = as_rows(bearings, 3, "bearings")
        targets, _ = as_rows(pixels, 2, "pixels")
        return fit_model(cls.name, cls.initial_models(directions, targets), directions, targets, fixed)
