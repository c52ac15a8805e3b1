"""Functions of cameras as one kernel each on a GPU, compiled by `torch.compile` at the first call.

On tensors each of the 60 elementwise operations of a formula is a kernel that reads and writes all points. A function
of points is compiled for one type and device with examples, and does not check its arguments, which takes longer than
the kernel of a million points: they are contiguous and have no derivatives.
"""

import os
import shutil
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import torch
from torch import Tensor

from omnisight.models import CameraModel
from omnisight.torch.domain_constants import CACHED_CAMERAS, flattened
from omnisight.torch.formulas import BoundFormula, Bounds, Formula
from omnisight.torch.tensor_functions import constant

# Oldest GPU that Triton supports.
MIN_CAPABILITY = (7, 0)
# Number of the example points. Kernels of other numbers are the same, but the compiler treats 0 and 1 as constants, and
# counts the elements of an array in 32 bits.
EXAMPLES, MAX_POINTS = 1 << 20, 1 << 29


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
    formula, flat = function.formula, array.detach().reshape(-1, array.shape[-1]).contiguous()
    with torch.no_grad():
        if not 1 < len(flat) <= MAX_POINTS:
            return function.evaluate(array)
        found, valid = values_kernel(formula, array.dtype, array.device)(flat, _vector(function, array))
        if formula.method == "unproject" and not valid.all():
            # Kernels take a fixed number of Newton steps: repeat the few points that have not converged.
            found[~valid], valid[~valid] = function.evaluate(flat[~valid])
    return found.view(*array.shape[:-1], -1), valid.view(array.shape[:-1])


def gradients(
    function: BoundFormula, array: Tensor, values: Tensor, valid: Tensor, gradient: Tensor
) -> tuple[Tensor, ...]:
    """Return the gradients by the points or pixels and by each parameter, of that by the values."""
    formula, flat = function.formula, array.detach().reshape(-1, array.shape[-1]).contiguous()
    given, use = gradient.reshape(-1, values.shape[-1]).contiguous(), valid.reshape(-1).contiguous()
    if 1 < len(flat) <= MAX_POINTS:
        kernel = gradients_kernel(formula, array.dtype, array.device)
    else:
        kernel = gradients_of(formula)
    by_array, by_vector = kernel(flat, _vector(function, array), use, given)
    parts = by_vector.to(function.parameters[0].dtype).split([x.numel() for x in function.parameters])
    return by_array.reshape(array.shape), *(
        part.view(x.shape) for part, x in zip(parts, function.parameters, strict=True)
    )


def view_map(
    project: BoundFormula, unproject: BoundFormula, rotation: Tensor, size: tuple[int, int], bounds: Bounds
) -> tuple[Tensor, Tensor]:
    """Return the pixels of a source that the pixels of a view show; see `compiled_loops.view_map`."""
    matrices, vectors = rotation.detach().reshape(-1, 3, 3), (_vector(project, rotation), _vector(unproject, rotation))
    with torch.no_grad():
        kernel = map_kernel(project.formula, unproject.formula)
        pixels, valid, seen = kernel(matrices, *vectors, constant(bounds, rotation), *size)
        if not seen.all():
            # As in `values`.
            v, u = (~seen).nonzero(as_tuple=True)
            bearings, _ = unproject.evaluate(torch.stack([u, v], -1).to(rotation.dtype))
            again, possible = project.evaluate(bearings @ matrices.mT)
            pixels[:, v, u], valid[:, v, u] = again, possible & bounds.contain(*again.unbind(-1))
    shape = *rotation.shape[:-2], *size[::-1]
    return pixels.view(*shape, 2), valid.view(shape)


@cache
def values_kernel(formula: Formula, dtype: torch.dtype, device: torch.device) -> Callable[..., Any]:
    """Return the kernel of a formula at points (N, K), for the vector of its parameters and constants."""

    def compute(flat: Tensor, vector: Tensor) -> tuple[Tensor, Tensor]:
        found, valid = formula.values(flat, formula.values_of(vector), formula.model.unrolled_steps)
        return torch.where(valid[:, None], found, torch.nan), valid

    return _compiled(formula, compute, *_examples(formula, dtype, device))


@cache
def gradients_kernel(formula: Formula, dtype: torch.dtype, device: torch.device) -> Callable[..., Any]:
    """Return the kernel of `gradients_of` a formula."""
    flat, vector = _examples(formula, dtype, device)
    gradient = flat.new_zeros(len(flat), 5 - flat.shape[1])
    return _compiled(formula, gradients_of(formula), flat, vector, flat[:, 0] == 0.0, gradient)


def gradients_of(formula: Formula) -> Callable[..., tuple[Tensor, Tensor]]:
    """Return a function for the products of a gradient (N, L) with the derivatives by points and by parameters."""
    count = formula.parameter_count

    def compute(flat: Tensor, vector: Tensor, valid: Tensor, gradient: Tensor) -> Any:
        parameters, constants = vector.split([count, formula.vector_length - count])

        def inside(flat: Tensor, parameters: Tensor) -> Tensor:
            m = formula.values_of(torch.cat([parameters, constants]))
            return formula.values(formula.inside(flat, valid, m), m, formula.model.unrolled_steps)[0]

        with torch.enable_grad():
            products = torch.func.vjp(inside, flat, parameters)[1]
        return products(torch.where(valid[:, None], gradient, 0.0))

    return compute


@cache
def map_kernel(project: Formula, unproject: Formula) -> Callable[..., Any]:
    """Return the kernel that maps the pixels of a view to a source, given matrices (B, 3, 3) and both vectors.

    It also returns which pixels of the view have a bearing.
    """

    def compute(
        rotation: Tensor, source: Tensor, target: Tensor, bounds: Tensor, width: int, height: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        u, v = (torch.arange(count, dtype=rotation.dtype, device=rotation.device) for count in (width, height))
        grid = u.expand(1, height, -1), v[:, None].expand(1, -1, width)
        (x, y, z), seen = unproject.components(grid, unproject.values_of(target), unproject.model.unrolled_steps)
        rows = [row.unbind(1) for row in rotation[..., None, None].unbind(1)]
        rotated = [r_x * x + r_y * y + r_z * z for r_x, r_y, r_z in rows]
        pixels, valid = project.components(rotated, project.values_of(source), project.model.unrolled_steps)
        valid = valid & seen & Bounds(*bounds.unbind()).contain(*pixels)
        return torch.stack([torch.where(valid, axis, torch.nan) for axis in pixels], -1), valid, seen[0]

    return torch.compile(compute, dynamic=True)


def _compiled(formula: Formula, function: Callable[..., Any], *examples: Tensor) -> Callable[..., Any]:
    """Compile a function for arrays like the examples, of any number of points, without checks of the arguments.

    The compiler divides the functions of formulas with tables into parts, which need the checks.
    """
    if formula.has_tables:
        return torch.compile(function, dynamic=True)
    # What is compiled is kept by the code of a function, and functions of all formulas have the same.
    own = FunctionType(function.__code__.replace(), function.__globals__, closure=function.__closure__)
    kernel = torch.compile(own, dynamic=True, options={"guard_filter_fn": lambda guards: [False] * len(guards)})
    with torch.no_grad():
        kernel(*examples)
    return kernel


def _examples(formula: Formula, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return points or pixels, and a vector of parameters and constants, whose values do not matter."""
    counts = (EXAMPLES, 3 if formula.method == "project" else 2), (formula.vector_length,)
    points, vector = (torch.zeros(shape, dtype=dtype, device=device) for shape in counts)
    return points, vector


def _vector(function: BoundFormula, array: Tensor) -> Tensor:
    """Return the parameters and constants of a function, which are read from the device only if they changed."""
    return _vector_on(array.device, array.dtype, function.numpy_model)


@lru_cache(maxsize=CACHED_CAMERAS)
def _vector_on(device: torch.device, dtype: torch.dtype, model: CameraModel) -> Tensor:
    values = torch.from_numpy(flattened(model))
    return torch.cat([torch.tensor(model.params), values]).to(device, dtype)
