"""Functions of cameras as one or a few kernels each on a GPU, compiled by TorchInductor at the first call.

On tensors each of the 60 elementwise operations of a formula is a kernel that reads and writes all points. A function
of points is compiled for one type and device with examples, and does not check its arguments, which takes longer than
the kernel of a million points: they are contiguous and have no derivatives. Formulas with tables are not compiled, as
the time for that grows exponentially with their length.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from types import FunctionType
from typing import Any

import torch
import torch._inductor
from torch import Tensor
from torch.fx.experimental.proxy_tensor import make_fx

from omnisight.torch.domain_constants import flattened, kept_by_version
from omnisight.torch.formulas import BoundFormula, BoundMap, Bounds, Formula
from omnisight.torch.sampling import averaged, interpolated
from omnisight.torch.tensor_functions import constant

# Oldest GPU that Triton supports.
MIN_CAPABILITY = (7, 0)
# Number of the example points. Kernels of other numbers are the same, but the compiler treats 0 and 1 as constants, and
# counts the elements of an array in 32 bits.
EXAMPLES, MAX_POINTS = 1 << 20, 1 << 29
# Arguments have the shapes of the examples, and indices are in bounds.
OPTIONS: dict[str, Any] = {"size_asserts": False, "assert_indirect_indexing": False}


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
    formula, flat = function.formula, _flat(array)
    if not 1 < len(flat) <= MAX_POINTS:
        with torch.no_grad():
            return function.evaluate(array)
    found, valid = values_kernel(formula, array.dtype, array.device)(flat, vector_of(function, array))
    if formula.method == "unproject" and iterates(formula) and not valid.all():
        # Kernels take a fixed number of Newton steps: repeat the few points that have not converged.
        with torch.no_grad():
            found[~valid], valid[~valid] = function.evaluate(flat[~valid])
    return (found, valid) if array.ndim == 2 else (found.view(*array.shape[:-1], -1), valid.view(array.shape[:-1]))


def gradients(
    function: BoundFormula, array: Tensor, values: Tensor, valid: Tensor, gradient: Tensor
) -> tuple[Tensor, ...]:
    """Return the gradients by the points or pixels and by each parameter, of that by the values."""
    formula, flat = function.formula, _flat(array)
    if 1 < len(flat) <= MAX_POINTS:
        kernel = gradients_kernel(formula, array.dtype, array.device)
    else:
        kernel = gradients_of(formula)
    by_array, *by_parameters = kernel(flat, vector_of(function, array), valid.reshape(-1), _flat(gradient))
    return by_array.view(array.shape), *(
        by.to(parameter.dtype) for by, parameter in zip(by_parameters, function.parameters, strict=True)
    )


def view_map(view: BoundMap) -> tuple[Tensor, Tensor]:
    """Return the pixels of a source that the pixels of a view show; see `compiled_loops.view_map`."""
    project, unproject, rotation, size, bounds = view
    matrices = rotation.detach().reshape(-1, 3, 3)
    with torch.no_grad():
        pixels, valid, seen = map_kernel(project.formula, unproject.formula)(matrices, *_numbers(view), *size)
        if iterates(unproject.formula) and not seen.all():
            # As in `values`.
            v, u = (~seen).nonzero(as_tuple=True)
            bearings, _ = unproject.evaluate(torch.stack([u, v], -1).to(rotation.dtype))
            again, possible = project.evaluate(bearings @ matrices.mT)
            pixels[:, v, u], valid[:, v, u] = again, possible & bounds.contain(*again.unbind(-1))
    shape = *rotation.shape[:-2], *size[::-1]
    return pixels.view(*shape, 2), valid.view(shape)


def can_remap(view: BoundMap, image: Tensor) -> bool:
    """Return whether `remap` computes the view of images (..., channels, height, width)."""
    images, rotations = image.shape[:-3], view.rotation.shape[:-2]
    is_paired = images == rotations or 1 in (images.numel(), rotations.numel())
    return is_paired and image.dtype == view.rotation.dtype and not iterates(view.unproject.formula)


def remap(view: BoundMap, image: Tensor, footprint: Tensor | None, *, periodic: bool) -> tuple[Tensor, Tensor]:
    """Return a view (..., channels, h, w), 0 where not valid, and its validity (..., h, w), by one kernel.

    Parameters
    ----------
    view
        The map of the view.
    image, footprint, periodic
        As in `sampling.sample`.
    """
    matrices, planes = view.rotation.detach().reshape(-1, 3, 3), image.detach().reshape(-1, *image.shape[-3:])
    width, height = view.size
    with torch.no_grad():
        atlas, level = averaged(planes, footprint, (height, width), periodic=periodic)
        places = constant(atlas.places, image)
        kernel = remap_kernel(view.project.formula, view.unproject.formula)
        values, valid = kernel(matrices, *_numbers(view), width, height, atlas.image, places, level)
    images, rotations = image.shape[:-3], view.rotation.shape[:-2]
    lead = torch.broadcast_shapes(images, rotations) if rotations else images
    return values.view(*lead, *values.shape[1:]), valid.view(*rotations, *valid.shape[1:])


@cache
def values_kernel(formula: Formula, dtype: torch.dtype, device: torch.device) -> Callable[..., Any]:
    """Return the kernel of a formula at points (N, K), for the vector of its parameters and constants."""

    def compute(flat: Tensor, vector: Tensor) -> tuple[Tensor, Tensor]:
        m = formula.values_of(vector)
        found, valid = formula.components(flat.unbind(1), m, formula.model.unrolled_steps)
        return _masked(found, valid)

    return _compiled(compute, *_examples(formula, dtype, device))


@cache
def gradients_kernel(formula: Formula, dtype: torch.dtype, device: torch.device) -> Callable[..., Any]:
    """Return the kernel of `gradients_of` a formula."""
    flat, vector = _examples(formula, dtype, device)
    return _compiled(
        gradients_of(formula), flat, vector, flat[:, 0] == 0.0, flat.new_zeros(len(flat), 5 - flat.shape[1])
    )


def gradients_of(formula: Formula) -> Callable[..., tuple[Tensor, ...]]:
    """Return a function for the products of a gradient (N, L) with the derivatives by points and by each parameter.

    Each point has parameters of its own, whose derivatives are summed at the end.
    """
    parameters = len(formula.fields)

    def compute(flat: Tensor, vector: Tensor, valid: Tensor, gradient: Tensor) -> Any:
        parts = formula.parts(vector)
        constants = parts[parameters:]
        own = [part[..., None].expand(*part.shape, flat.shape[0]) for part in parts[:parameters]]

        def inside(components: tuple[Tensor, ...], own: list[Tensor]) -> list[Tensor]:
            m = formula.values_from([*own, *constants])
            return formula.components(formula.inside(components, valid, m), m, formula.model.unrolled_steps)[0]

        with torch.enable_grad():
            products = torch.func.vjp(inside, flat.unbind(1), own)[1]
        by_components, by_own = products([torch.where(valid, x, 0.0) for x in gradient.unbind(1)])
        return torch.stack(by_components, 1), *(by.sum(-1).double() for by in by_own)

    return compute


@cache
def map_kernel(project: Formula, unproject: Formula) -> Callable[..., Any]:
    """Return the kernel that maps the pixels of a view to a source, given matrices (B, 3, 3) and `_numbers`.

    It also returns which pixels of the view have a bearing.
    """

    def compute(rotation: Tensor, source: Tensor, target: Tensor, bounds: Tensor, width: int, height: int) -> Any:
        pixels, valid, seen = _mapped((project, source), (unproject, target), rotation, bounds, (width, height))
        return *_masked(pixels, valid), seen[0]

    return _compiled_by_shape(compute)


@cache
def remap_kernel(project: Formula, unproject: Formula) -> Callable[..., Any]:
    """Return the kernel that interpolates the atlas of images (B, C, H, W) at the pixels of `map_kernel`."""

    def compute(
        rotation: Tensor, source: Tensor, target: Tensor, bounds: Tensor, width: int, height: int, *atlas: Any
    ) -> Any:
        (u, v), valid, _ = _mapped((project, source), (unproject, target), rotation, bounds, (width, height))
        image, places, level = atlas
        values = interpolated(image, places, level, torch.where(valid, u, 0.0), torch.where(valid, v, 0.0))
        return torch.stack([torch.where(valid, channel, 0.0) for channel in values], 1), valid

    return _compiled_by_shape(compute)


def _mapped(
    project: tuple[Formula, Tensor],
    unproject: tuple[Formula, Tensor],
    rotation: Tensor,
    bounds: Tensor,
    size: tuple[int, int],
) -> tuple[list[Tensor], Tensor, Tensor]:
    """Return the components (B, h, w) of the pixels of a view, which are valid, and which have a bearing."""
    (source, source_vector), (target, target_vector), (width, height) = project, unproject, size
    u, v = (torch.arange(count, dtype=rotation.dtype, device=rotation.device) for count in (width, height))
    grid = u.expand(1, height, -1), v[:, None].expand(1, -1, width)
    (x, y, z), seen = target.components(grid, target.values_of(target_vector), target.model.unrolled_steps)
    rows = [row.unbind(1) for row in rotation[..., None, None].unbind(1)]
    rotated = [r_x * x + r_y * y + r_z * z for r_x, r_y, r_z in rows]
    pixels, valid = source.components(rotated, source.values_of(source_vector), source.model.unrolled_steps)
    return pixels, valid & seen & Bounds(*bounds.unbind()).contain(*pixels), seen


@cache
def iterates(formula: Formula) -> bool:
    """Return whether a formula iterates: then the number of its operations depends on that of the steps."""

    def operations(steps: int) -> int:
        def compute(flat: Tensor, vector: Tensor) -> tuple[Tensor, Tensor]:
            return formula.values(flat, formula.values_of(vector), steps)

        return len(make_fx(compute, tracing_mode="fake")(*examples).graph.nodes)

    examples = _examples(formula, torch.float32, torch.device("cpu"))
    return operations(0) != operations(1)


def _masked(values: Sequence[Tensor], valid: Tensor) -> tuple[Tensor, Tensor]:
    """Return values joined along the last axis, NaN where not valid, and which are valid."""
    return torch.stack([torch.where(valid, x, torch.nan) for x in values], -1), valid


def _compiled_by_shape(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function for the first sizes of its arguments, and for all if others follow: division by these is slow.

    Results of the compiler are cached by the code of a function, so each has a copy of its own. At each call only the
    arguments are checked, as the formulas do not change.
    """
    own = FunctionType(function.__code__.replace(), function.__globals__, closure=function.__closure__)

    def needed(guards: Sequence[Any]) -> list[bool]:
        return [not (g.is_global or any(name in g.name for name in own.__code__.co_freevars)) for g in guards]

    return torch.compile(own, options=OPTIONS | {"guard_filter_fn": needed})


def _compiled(function: Callable[..., Any], *examples: Tensor) -> Callable[..., Any]:
    """Compile a function for arrays like the examples, of any number of points, without checks of the arguments."""
    with torch.no_grad():
        graph = make_fx(function, tracing_mode="symbolic")(*examples)
        inputs = [node.meta["val"] for node in graph.graph.find_nodes(op="placeholder")]
        kernel: Any = torch._inductor.compile(graph, inputs, OPTIONS)
    return kernel


def _examples(formula: Formula, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return points or pixels, and a vector of parameters and constants, whose values do not matter."""
    counts = (EXAMPLES, 3 if formula.method == "project" else 2), (formula.vector_length,)
    points, vector = (torch.zeros(shape, dtype=dtype, device=device) for shape in counts)
    return points, vector


def vector_of(function: BoundFormula, array: Tensor) -> Tensor:
    """Return the parameters and constants of a function, which are read from the device only if they changed."""

    def compute() -> Tensor:
        model = function.numpy_model
        values = torch.cat([torch.tensor(model.params), torch.from_numpy(flattened(model))])
        return values.to(array.device, array.dtype)

    return kept_by_version(function.parameters, (function.formula, array.dtype), compute)


def _numbers(view: BoundMap) -> tuple[Tensor, Tensor, Tensor]:
    """Return the vectors of the source and of the target of a map, and the bounds of the source."""
    like = view.rotation
    return vector_of(view.project, like), vector_of(view.unproject, like), constant(view.bounds, like)


def _flat(array: Tensor) -> Tensor:
    """Return points or pixels (N, K) in contiguous memory."""
    return (array.detach() if array.ndim == 2 else array.detach().reshape(-1, array.shape[-1])).contiguous()
