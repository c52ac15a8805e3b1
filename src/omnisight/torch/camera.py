"""Central cameras as modules: projection, unprojection and remap with derivatives."""

import dataclasses
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from omnisight.camera import Camera as NumpyCamera
from omnisight.torch.compiled_loops import CompiledLoop, Method, can_read, fill_map, has_gradient
from omnisight.torch.domain_constants import numpy_model
from omnisight.torch.formulas import Formulas
from omnisight.torch.sampling import pixel_footprint, sample


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
        self.size, self._camera, self._formulas = camera.size, camera, Formulas(camera.model)
        for field in dataclasses.fields(camera.model):  # pyright: ignore[reportArgumentType]
            value = torch.tensor(getattr(camera.model, field.name), dtype=dtype, device=device)
            self.register_parameter(field.name, nn.Parameter(value, field.metadata.get("free", True)))
        period = camera.model.period
        self.period = period if period is not None and abs(period - camera.width) < 0.5 else None

    def numpy(self) -> NumpyCamera:
        """Return the NumPy camera with the current values of the parameters."""
        flat = torch.cat([p.detach().double().reshape(-1) for p in self._parameters_of_model()]).cpu().numpy()
        return dataclasses.replace(self._camera, model=self._camera.model.with_params(flat), covariance=None)

    def extra_repr(self) -> str:
        """Return the model and the size of the image."""
        return f"{self._formulas.model.name}, {self.size[0]}x{self.size[1]}"

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
        return self._evaluate("project", points)

    def unproject(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Return the unit bearings (..., 3) of pixels (..., 2), NaN where not valid, and their validity (...).

        Derivatives of iterated inverses follow from the implicit function theorem.

        Raises
        ------
        ValueError
            If the pixels have another shape or type.
        """
        _check(pixels, 2, "pixels")
        return self._evaluate("unproject", pixels)

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
        mine, others = self._parameters_of_model(), target._parameters_of_model()
        rotation = torch.eye(3, device=mine[0].device) if target_from_source is None else target_from_source
        _check(rotation, 3, "target_from_source")
        if can_read(rotation, *mine, *others) and not has_gradient(rotation, *mine, *others):
            models = numpy_model(mine, self._formulas.model.name), numpy_model(others, target._formulas.model.name)
            shape = *rotation.shape[:-2], target.size[1], target.size[0]
            pixels, valid = rotation.new_empty(*shape, 2), rotation.new_empty(shape, dtype=torch.bool)
            for view in np.ndindex(rotation.shape[:-2]):
                fill_map(*models, rotation[view].T, self._covers, pixels[view], valid[view])
            return pixels, valid
        bearings, seen = target.unproject(target.grid(rotation.dtype))
        # Without NaN, which would spread to the derivative of the rotation.
        bearings = torch.where(seen[..., None], bearings, 0.0) @ rotation.unsqueeze(-3)
        pixels, valid = self.project(bearings)
        return pixels, valid & seen & self._covers(*pixels.unbind(-1))

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
        return [getattr(self, name) for name in self._formulas.fields]

    def _covers(self, u: Any, v: Any) -> Any:
        """Return which pixels an image covers: across the seam of a panorama coordinates may round."""
        (width, height), seam = self.size, 0.0 if self.period is None else 0.5
        return (u >= -0.5 - seam) & (u < width - 0.5 + seam) & (v >= -0.5) & (v < height - 0.5)

    def _evaluate(self, method: Method, array: Tensor) -> tuple[Tensor, Tensor]:
        parameters = self._parameters_of_model()
        if can_read(array, *parameters):
            values, valid = CompiledLoop.apply(self._formulas, method, array, *parameters)
            return values, valid
        return getattr(self._formulas, method)(array, parameters)


def _check(array: Tensor, width: int, name: str) -> None:
    if array.ndim == 0 or array.shape[-1] != width or array.dtype not in (torch.float32, torch.float64):
        found = f"shape {tuple(array.shape)} of {array.dtype}"
        raise ValueError(f"{name} must be float32 or float64 of shape (..., {width}), got {found}")
