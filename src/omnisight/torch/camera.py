"""Central cameras as modules: projection, unprojection and remap with derivatives."""

import dataclasses
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from omnisight.camera import Camera as NumpyCamera
from omnisight.models import CameraModel
from omnisight.models._elementwise import MAX_ITERATIONS, project_point, unproject_pixel
from omnisight.torch.domain_constants import constants_vector, domain_constants, numpy_model
from omnisight.torch.sampling import pixel_footprint, sample

# Newton steps of compiled functions, which cannot stop when all points have converged: enough up to 99 % of the rim.
COMPILED_ITERATIONS = 12


class FormulaValues:
    """The parameters and constants that formulas take, by name, and the class of the model."""

    axis_u: Tensor
    axis_v: Tensor

    def __init__(self, model: type[CameraModel]) -> None:
        self.model = model


class Camera(nn.Module):
    """A central camera whose parameters are those of its model: `camera.fx`, `camera.k1`, ...

    Each field of the model is a parameter: a scalar, or a vector for a tuple of coefficients. Those that a calibration
    keeps by default (`Parameter.free` is False: skew, knots) do not require a gradient. Parameters are float64 by
    default; results have the type of the points or pixels.

    All methods are differentiable by their inputs and by the parameters, up to the third derivative, on every device,
    and inside `torch.compile`. Derivatives of points and pixels outside the domain of the model are zero.

    Parameters
    ----------
    camera
        A central camera or a view: a view is a camera.
    dtype, device
        Type and device of the parameters.

    Attributes
    ----------
    size
        (width, height) of the image, px.
    period
        Width in px after which the image repeats, if the image is that wide, or None.

    Raises
    ------
    ValueError
        If the camera is not central.
    """

    def __init__(
        self, camera: NumpyCamera, dtype: torch.dtype = torch.float64, device: torch.device | str | None = None
    ) -> None:
        super().__init__()
        if not isinstance(camera, NumpyCamera):  # pyright: ignore[reportUnnecessaryIsInstance]
            kind = type(camera).__name__
            raise ValueError(f"omnisight.torch.Camera takes a central camera (omnisight.Camera), got {kind}")
        self.size, self._camera, self._model = camera.size, camera, type(camera.model)
        self._fields = tuple(field.name for field in dataclasses.fields(camera.model))  # pyright: ignore[reportArgumentType]
        for field in dataclasses.fields(camera.model):  # pyright: ignore[reportArgumentType]
            value = torch.tensor(getattr(camera.model, field.name), dtype=dtype, device=device)
            self.register_parameter(field.name, nn.Parameter(value, field.metadata.get("free", True)))
        constants = domain_constants(camera.model)
        self._shapes = {name: np.shape(value) for name, value in constants.items()}
        self._counts = [int(np.prod(shape)) for shape in self._shapes.values()]
        period = camera.model.period
        self.period = period if period is not None and abs(period - camera.width) < 0.5 else None

    def numpy(self) -> NumpyCamera:
        """Return the NumPy camera with the current values of the parameters."""
        flat = torch.cat([p.detach().double().reshape(-1) for p in self._parameters_of_model()]).cpu().numpy()
        return dataclasses.replace(self._camera, model=self._camera.model.with_params(flat), covariance=None)

    def extra_repr(self) -> str:
        """Return the model and the size of the image."""
        return f"{self._model.name}, {self.size[0]}x{self.size[1]}"

    def project(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Project points of the camera frame.

        Parameters
        ----------
        points
            (..., 3) float32 or float64, x right, y down, z forward.

        Returns
        -------
        pixels
            (..., 2), NaN where not valid.
        valid
            (...) bool, whether the point lies inside the one-to-one domain of the model.

        Raises
        ------
        ValueError
            If the points have another shape or type.
        """
        _check(points, 3, "points")
        known = self._of_compiled_loop("project", points)
        if known is not None and not torch.is_grad_enabled():
            return known
        axis = points.new_tensor((0.0, 0.0, 1.0))
        return _apply(project_point, self._values(points.dtype), points, axis, known)

    def unproject(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Return the unit bearings (..., 3) of pixels (..., 2), NaN where not valid, and their validity (...).

        Derivatives of iterated inverses follow from the implicit function theorem.

        Raises
        ------
        ValueError
            If the pixels have another shape or type.
        """
        _check(pixels, 2, "pixels")
        known = self._of_compiled_loop("unproject", pixels)
        if known is not None and not torch.is_grad_enabled():
            return known
        m = self._values(pixels.dtype)
        return _apply(unproject_pixel, m, pixels, torch.stack([m.axis_u, m.axis_v]), known)

    def in_image(self, pixels: Tensor) -> Tensor:
        """Return which pixels (..., 2) lie in the image: in [-0.5, width - 0.5) x [-0.5, height - 0.5)."""
        u, v = pixels.unbind(-1)
        return (u >= -0.5) & (u < self.size[0] - 0.5) & (v >= -0.5) & (v < self.size[1] - 0.5)

    def grid(self, dtype: torch.dtype = torch.float32, device: torch.device | str | None = None) -> Tensor:
        """Return the pixels (height, width, 2) of the image, on the device of the camera by default."""
        device = device or self._parameters_of_model()[0].device
        u, v = (torch.arange(count, dtype=dtype, device=device) for count in self.size)
        return torch.stack(torch.meshgrid(u, v, indexing="xy"), -1)

    def map(self, target: "Camera", target_from_source: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return the pixel of this camera that each pixel of a view shows.

        Parameters
        ----------
        target
            The camera of the view.
        target_from_source
            (..., 3, 3) rotations of bearings from this camera to the view; the identity by default. Their type is that
            of the result, float32 by default.

        Returns
        -------
        pixels
            (..., height, width, 2) of this camera.
        valid
            (..., height, width), whether the pixel lies in the image of this camera.
        """
        rotation = target_from_source
        bearings, seen = target.unproject(target.grid() if rotation is None else target.grid(rotation.dtype))
        if rotation is not None:
            # Without NaN, which would spread to the derivative of the rotation.
            bearings = torch.where(seen[..., None], bearings, 0.0) @ rotation.unsqueeze(-3)
        pixels, valid = self.project(bearings)
        inside = self.in_image(pixels)
        if self.period is not None:  # coordinates that round across the seam are valid
            u, v = pixels.unbind(-1)
            inside = (u >= -1.0) & (u <= self.size[0]) & (v >= -0.5) & (v < self.size[1] - 0.5)
        return pixels, valid & seen & inside

    def remap(
        self, image: Tensor, target: "Camera", target_from_source: Tensor | None = None, *, antialias: bool = True
    ) -> tuple[Tensor, Tensor]:
        """Remap an image of this camera to another camera.

        Parameters
        ----------
        image
            (..., channels, height, width), float32 or float64.
        target, target_from_source
            As in `map`; leading dimensions of images and rotations are broadcast.
        antialias
            Average pixels of the image where the view is smaller, by mipmaps.

        Returns
        -------
        view
            (..., channels, height, width) of the target, 0 where not valid.
        valid
            (..., height, width), whether the image covers the pixel.

        Raises
        ------
        ValueError
            If the size of the image differs from that of the camera.
        """
        if tuple(image.shape[-2:]) != self.size[::-1]:
            found, expected = f"{image.shape[-1]}x{image.shape[-2]}", f"{self.size[0]}x{self.size[1]}"
            raise ValueError(f"the image is {found} px, but its camera {expected}: scale the camera (Camera.scaled)")
        pixels, valid = self.map(target, target_from_source)
        footprint = pixel_footprint(self, pixels.detach()) if antialias else None
        return sample(image, pixels, valid, footprint=footprint, periodic=self.period is not None), valid

    def _parameters_of_model(self) -> list[Tensor]:
        return [getattr(self, name) for name in self._fields]

    def _of_compiled_loop(self, method: str, array: Tensor) -> tuple[Tensor, Tensor] | None:
        """Return the results of NumPy's compiled loop, without derivatives; None if it cannot read the array.

        It computes a million points in the time of two elementwise operations of torch.
        """
        if torch.compiler.is_compiling() or array.device.type != "cpu":
            return None
        parameters = self._parameters_of_model()
        functorch = torch._C._functorch  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
        if any(functorch.is_functorch_wrapped_tensor(x) for x in (array, *parameters)):
            return None
        values, valid = getattr(numpy_model(parameters, self._model.name), method)(array.detach().numpy())
        return torch.from_numpy(values).to(array.dtype), torch.from_numpy(valid)

    def _values(self, dtype: torch.dtype) -> FormulaValues:
        """Return the values of the formulas in a type."""
        m = FormulaValues(self._model)
        for field in self._fields:
            setattr(m, field, getattr(self, field).to(dtype))
        for field, value in self._model.derived(m).items():
            setattr(m, field, value)
        for field in self._fields:
            if getattr(m, field).ndim and field in self._model.kernel_type._fields:
                setattr(m, field, getattr(m, field).unbind())
        parameters = [parameter.detach() for parameter in self._parameters_of_model()]
        vector = constants_vector(parameters, self._model.name, sum(self._counts))
        for (field, shape), part in zip(self._shapes.items(), vector.to(dtype).split(self._counts), strict=True):
            setattr(m, field, part.reshape(shape))
        return m


def _check(array: Tensor, width: int, name: str) -> None:
    if array.ndim == 0 or array.shape[-1] != width or array.dtype not in (torch.float32, torch.float64):
        found = f"shape {tuple(array.shape)} of {array.dtype}"
        raise ValueError(f"{name} must be float32 or float64 of shape (..., {width}), got {found}")


def _apply(
    formula: Any, m: FormulaValues, array: Tensor, safe: Tensor, known: tuple[Tensor, Tensor] | None
) -> tuple[Tensor, Tensor]:
    """Return the values of a formula at points (..., K), NaN where not valid, and their validity.

    Derivatives at points outside the domain may be NaN, which would spread to the parameters: a first pass, unless its
    results are known, finds the valid points, and the second one replaces the others by the point `safe`.
    """
    iterations = COMPILED_ITERATIONS if torch.compiler.is_compiling() else MAX_ITERATIONS
    values: list[Tensor] = []
    if known is None:
        with torch.no_grad():
            *values, valid = formula(m, *array.unbind(-1), iterations)
            valid = valid & (torch.abs(values[0]) != torch.inf)
    else:
        valid = known[1]
    if torch.is_grad_enabled():
        *values, _ = formula(m, *torch.where(valid[..., None], array, safe).unbind(-1), iterations)
    result = torch.stack(values, -1)
    return torch.where(valid[..., None], result, torch.nan), valid
