"""Central cameras as modules: projection, unprojection and remap with derivatives."""

import dataclasses
from typing import Any

import torch
from torch import Tensor, nn

from omnisight.camera import Camera as NumpyCamera
from omnisight.torch import fused_kernels
from omnisight.torch.evaluation import Evaluation, fast_code
from omnisight.torch.formulas import BoundFormula, BoundMap, Bounds, Formula, Method
from omnisight.torch.sampling import sample
from omnisight.torch.tensor_functions import constant, has_gradient

# Spacing of the pixels at which the footprint of a map is computed: it changes slowly.
FOOTPRINT_STEP_PX = 8
METHODS: tuple[Method, ...] = ("project", "unproject")


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
        self.size, self._camera = camera.size, camera
        self._formulas = {method: Formula(method, camera.model) for method in METHODS}
        self._is_fused = False
        for field in dataclasses.fields(camera.model):  # pyright: ignore[reportArgumentType]
            value = torch.tensor(getattr(camera.model, field.name), dtype=dtype, device=device)
            self.register_parameter(field.name, nn.Parameter(value, field.metadata.get("free", True)))
        period = camera.model.period
        self.period = period if period is not None and abs(period - camera.width) < 0.5 else None

    def numpy(self) -> NumpyCamera:
        """Return the NumPy camera with the current values of the parameters."""
        return dataclasses.replace(self._camera, model=self._bound("project").numpy_model, covariance=None)

    def compile(self) -> None:  # pyright: ignore[reportIncompatibleMethodOverride] -- without options of the compiler
        """Fuse the operations of each function to one or a few kernels on a GPU, compiled at its first call.

        Compilation takes seconds for a closed formula, 20 s for an iteration, and is repeated for another type of
        points. It changes nothing on the CPU, whose loops are compiled, inside `torch.compile`, which fuses itself, and
        for models with tables (`spline`), whose compilation would take minutes.

        Raises
        ------
        RuntimeError
            If the machine has a GPU, but Triton or a C compiler is missing.
        """
        fused_kernels.check_support()
        self._is_fused = True

    def extra_repr(self) -> str:
        """Return the model and the size of the image."""
        return f"{self._camera.model.name}, {self.size[0]}x{self.size[1]}"

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
        device = device or next(self.parameters()).device
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
        return self._map(target, self._bound_map(target, target_from_source))

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
        view, periodic = self._bound_map(target, target_from_source), self.period is not None
        inputs = image, *view.variables
        is_fused = fast_code(self._fuses(*view.formulas), *inputs) is fused_kernels and not has_gradient(*inputs)
        if is_fused and fused_kernels.can_remap(view, image):
            footprint = self._footprint(*self._neighbours(target, view.rotation)) if antialias else None
            return fused_kernels.remap(view, image, footprint, periodic=periodic)
        pixels, valid = self._map(target, view)
        footprint = self._footprint(*(pixels[..., v, u, :] for u, v in target._sparse_grid())) if antialias else None
        return sample(image, pixels, valid, footprint=footprint, periodic=periodic), valid

    def _fuses(self, *formulas: Formula) -> bool:
        """Return whether kernels may evaluate formulas."""
        return self._is_fused and not any(formula.has_tables for formula in formulas)

    def _bound(self, method: Method) -> BoundFormula:
        """Return the formula of a method with the parameters of this camera."""
        formula, own = self._formulas[method], self._parameters
        # Attributes of a module are slow; functions of parameters (torch.nn.utils.parametrize) are attributes only.
        values: Any = [own[name] if name in own else getattr(self, name) for name in formula.fields]
        return BoundFormula(formula, values)

    def _bound_map(self, target: "Camera", target_from_source: Tensor | None) -> BoundMap:
        """Return the map of a view; see `map`."""
        project, unproject = self._bound("project"), target._bound("unproject")
        rotation = target_from_source
        if rotation is None:
            like = torch.empty(0, dtype=torch.float32, device=project.parameters[0].device)
            rotation = constant(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), like)
        _check(rotation, 3, "target_from_source")
        return BoundMap(project, unproject, rotation.mT, target.size, self._bounds)

    def _map(self, target: "Camera", view: BoundMap) -> tuple[Tensor, Tensor]:
        """Return the pixels of `map`."""
        code = fast_code(self._fuses(*view.formulas), *view.variables)
        if code is not None and not has_gradient(*view.variables):
            return code.view_map(view)
        return self._map_at(target.grid(view.rotation.dtype), target, view.rotation)

    def _map_at(self, grid: Tensor, target: "Camera", source_from_target: Tensor) -> tuple[Tensor, Tensor]:
        """Return the pixels (..., *shape, 2) that the pixels (*shape, 2) of a view show, and which are valid."""
        bearings, seen = target.unproject(grid)
        rotation = source_from_target.mT.reshape(*source_from_target.shape[:-2], *(1,) * (grid.ndim - 3), 3, 3)
        # Without NaN, which would propagate to the derivative of the rotation.
        bearings = torch.where(seen[..., None], bearings, 0.0) @ rotation.unsqueeze(-3)
        pixels, valid = self.project(bearings)
        return pixels, valid & seen & self._bounds.contain(*pixels.unbind(-1))

    @property
    def _bounds(self) -> Bounds:
        """The pixels that an image covers: across the seam of a panorama coordinates may round."""
        (width, height), seam = self.size, 0.0 if self.period is None else 0.5
        return Bounds(-0.5 - seam, width - 0.5 + seam, -0.5, height - 0.5)

    def _sparse_grid(self) -> list[tuple[Tensor, Tensor]]:
        """Return columns (columns,) and rows (rows, 1) of every eighth pixel, and of those below and right of them."""
        width, height = self.size
        device = next(self.parameters()).device
        u, v = (
            torch.arange(0, count, FOOTPRINT_STEP_PX, device=device).clamp(max=max(count - 2, 0)) for count in self.size
        )
        v = v[:, None]
        return [(u, v), (u, torch.clamp_max(v + 1, height - 1)), (torch.clamp_max(u + 1, width - 1), v)]

    @torch.no_grad()
    def _neighbours(self, target: "Camera", source_from_target: Tensor) -> tuple[Tensor, ...]:
        """Return the pixels (..., rows, columns, 2) of this camera that `_sparse_grid` of a view shows."""
        grids = [torch.stack(torch.broadcast_tensors(u, v), -1) for u, v in target._sparse_grid()]
        pixels, _ = self._map_at(torch.stack(grids).to(source_from_target.dtype), target, source_from_target)
        return pixels.unbind(-4)

    @torch.no_grad()
    def _footprint(self, start: Tensor, below: Tensor, right: Tensor) -> Tensor:
        """Return how many pixels of this camera a pixel of a view spans in its denser direction, 1 where unknown.

        In a periodic image columns are weighted by the cosine of the latitude, because near a pole many of them have
        nearly the same direction.

        Parameters
        ----------
        start, below, right
            (..., rows, columns, 2) the pixels of this camera that `_sparse_grid` of the view shows.
        """
        scale = torch.ones_like(start[..., 0])
        if self.period is not None:
            v = start[..., 1]
            bearings, _ = self.unproject(torch.stack([torch.full_like(v, self.size[0] / 2), v], -1))
            scale = torch.hypot(bearings[..., 0], bearings[..., 2])
        footprint = torch.ones_like(scale)
        for neighbour in (below, right):
            du, dv = (neighbour - start).unbind(-1)
            if self.period is not None:
                du = du - self.period * torch.round(du / self.period)
            length = torch.hypot(du * scale, dv)
            footprint = torch.where(length > footprint, length, footprint)  # False for NaN
        return footprint

    def _evaluate(self, method: Method, array: Tensor) -> tuple[Tensor, Tensor]:
        function = self._bound(method)
        code = fast_code(self._fuses(function.formula), array, *function.parameters)
        if code is None:
            return function.evaluate(array)
        if not has_gradient(array, *function.parameters):
            return code.values(function, array)
        return Evaluation.apply(code, function, array, *function.parameters)


def _check(array: Tensor, width: int, name: str) -> None:
    if array.ndim == 0 or array.shape[-1] != width or array.dtype not in (torch.float32, torch.float64):
        found = f"shape {tuple(array.shape)} of {array.dtype}"
        raise ValueError(f"{name} must be float32 or float64 of shape (..., {width}), got {found}")
