"""Functions of cameras as one kernel each on a GPU, compiled by `torch.compile` at the first call.

On tensors each of the 60 elementwise operations of a formula is a kernel that reads and writes all points.
"""

import os
import shutil
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.util import find_spec
from typing import Any

import torch
from torch import Tensor

from omnisight.models import CameraModel
from omnisight.torch.domain_constants import CACHED_CAMERAS, flattened
from omnisight.torch.formulas import BoundFormula, Bounds, Formula
from omnisight.torch.tensor_functions import constant

# Oldest GPU that Triton supports.
MIN_CAPABILITY = (7, 0)


def check_support() -> None:
    """Check that kernels can be compiled on this machine, which may have no GPU.

    Raises
    ------
    RuntimeError
        If there is a GPU without Triton or a C compiler, or an old one.
    """
    if not torch.cuda.is_available():
        return
    missing = [] if find_spec("triton") else ["Triton (pip install triton)"]
    if "CC" not in os.environ and not any(map(shutil.which, ("cc", "gcc", "clang"))):
        missing.append("a C compiler (gcc or clang)")
    if torch.cuda.get_device_capability() < MIN_CAPABILITY:
        missing.append("a GPU of compute capability 7.0 or later")
    if missing:
        raise RuntimeError(f"Camera.compile needs {' and '.join(missing)}; without it the camera runs uncompiled")


def values(function: BoundFormula, array: Tensor) -> tuple[Tensor, Tensor]:
    """Return pixels or bearings and their validity."""
    flat = array.detach().reshape(-1, array.shape[-1])
    found, valid = values_kernel(function.formula)(flat, _vector(function, array))
    if function.formula.method == "unproject" and not valid.all():
        # Kernels take a fixed number of Newton steps: repeat the few points that have not converged.
        with torch.no_grad():
            found[~valid], valid[~valid] = function.evaluate(flat[~valid])
    return found.reshape(*array.shape[:-1], -1), valid.reshape(array.shape[:-1])


def gradients(
    function: BoundFormula, array: Tensor, values: Tensor, valid: Tensor, gradient: Tensor
) -> tuple[Tensor, ...]:
    """Return the gradients by the points or pixels and by each parameter, of that by the values."""
    flat, given = array.detach().reshape(-1, array.shape[-1]), gradient.reshape(-1, values.shape[-1])
    kernel = gradients_kernel(function.formula)
    by_array, by_vector = kernel(flat, _vector(function, array), valid.reshape(-1), given)
    counts = [parameter.numel() for parameter in function.parameters]
    parts = by_vector.split([*counts, len(by_vector) - sum(counts)])
    by_parameters = (part.reshape(x.shape).to(x.dtype) for part, x in zip(parts, function.parameters, strict=False))
    return by_array.reshape(array.shape), *by_parameters


def view_map(
    project: BoundFormula, unproject: BoundFormula, rotation: Tensor, size: tuple[int, int], bounds: Bounds
) -> tuple[Tensor, Tensor]:
    """Return the pixels of a source that the pixels of a view show; see `compiled_loops.view_map`."""
    width, height = size
    u, v = (torch.arange(count, dtype=rotation.dtype, device=rotation.device) for count in size)
    grid = torch.stack([u.expand(height, -1), v[:, None].expand(-1, width)], -1)
    bearings, _ = values(unproject, grid)
    pixels, valid = map_kernel(project.formula)(
        bearings, rotation.detach().reshape(-1, 3, 3), _vector(project, rotation), constant(bounds, rotation)
    )
    shape = *rotation.shape[:-2], height, width
    return pixels.reshape(*shape, 2), valid.reshape(shape)


@cache
def values_kernel(formula: Formula) -> Callable[..., Any]:
    """Return the kernel of a formula at points (N, K), for the vector of its parameters and constants."""

    def compute(flat: Tensor, vector: Tensor) -> tuple[Tensor, Tensor]:
        found, valid = formula.values(flat, formula.values_of(vector), formula.model.unrolled_steps)
        return torch.where(valid[:, None], found, torch.nan), valid

    return torch.compile(compute, dynamic=True)


@cache
def gradients_kernel(formula: Formula) -> Callable[..., Any]:
    """Return the kernel of the products of a gradient (N, L) with the derivatives by points and by the vector."""

    def compute(flat: Tensor, vector: Tensor, valid: Tensor, gradient: Tensor) -> Any:
        def inside(flat: Tensor, vector: Tensor) -> Tensor:
            m = formula.values_of(vector)
            return formula.values(formula.inside(flat, valid, m), m, formula.model.unrolled_steps)[0]

        with torch.enable_grad():
            products = torch.func.vjp(inside, flat, vector)[1]
        return products(torch.where(valid[:, None], gradient, 0.0))

    return torch.compile(compute, dynamic=True)


@cache
def map_kernel(formula: Formula) -> Callable[..., Any]:
    """Return the kernel that projects bearings (H, W, 3), NaN where there are none, rotated by matrices (B, 3, 3)."""

    def compute(bearings: Tensor, rotation: Tensor, vector: Tensor, bounds: Tensor) -> tuple[Tensor, Tensor]:
        rows = rotation[:, None, None].unbind(-2)
        rotated = torch.stack([(row * bearings).sum(-1) for row in rows], -1)
        pixels, valid = formula.values(rotated, formula.values_of(vector), formula.model.unrolled_steps)
        valid = valid & Bounds(*bounds.unbind()).contain(*pixels.unbind(-1))
        return torch.where(valid[..., None], pixels, torch.nan), valid

    return torch.compile(compute, dynamic=True)


def _vector(function: BoundFormula, array: Tensor) -> Tensor:
    """Return the parameters and constants of a function, which are read from the device only if they changed."""
    return _vector_on(array.device, array.dtype, function.numpy_model)


@lru_cache(maxsize=CACHED_CAMERAS)
def _vector_on(device: torch.device, dtype: torch.dtype, model: CameraModel) -> Tensor:
    values = torch.from_numpy(flattened(model))
    return torch.cat([torch.tensor(model.params), values]).to(device, dtype)
