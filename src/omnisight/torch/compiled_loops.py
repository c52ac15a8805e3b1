"""NumPy's compiled loops and the Jacobians of the models, as functions of torch on the CPU.

The loops compute a million points in the time of two elementwise operations of torch. The products of a gradient with
the Jacobians are computed in blocks that stay in the cache, while differentiation of the formulas keeps a hundred
intermediate results of all points.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd import forward_ad

from omnisight.models import CameraModel
from omnisight.parallel import parallel_for
from omnisight.torch.domain_constants import numpy_model
from omnisight.torch.formulas import Formulas
from omnisight.torch.tensor_functions import is_traced

Method = Literal["project", "unproject"]
# Points whose Jacobians are computed at once.
BLOCK = 4096
# Rows of a map that are computed at once.
BAND_ROWS = 8


def can_read(*tensors: Tensor) -> bool:
    """Return whether NumPy can read tensors, and no forward derivatives are computed."""
    return all(
        not is_traced(x) and x.device.type == "cpu" and forward_ad.unpack_dual(x).tangent is None for x in tensors
    )


def has_gradient(*tensors: Tensor) -> bool:
    """Return whether results of tensors have derivatives."""
    return torch.is_grad_enabled() and any(x.requires_grad for x in tensors)


class CompiledLoop(torch.autograd.Function):
    """A projection or unprojection with first derivatives by Jacobians; higher ones are those of the formulas."""

    @staticmethod
    def forward(
        ctx: Any, formulas: Formulas, method: Method, array: Tensor, *parameters: Tensor
    ) -> tuple[Tensor, Tensor]:
        values, valid = getattr(numpy_model(parameters, formulas.model.name), method)(array.detach().numpy())
        result, is_valid = torch.from_numpy(values).to(array.dtype), torch.from_numpy(valid)
        ctx.formulas, ctx.method = formulas, method
        ctx.save_for_backward(array, result, is_valid, *parameters)
        ctx.mark_non_differentiable(is_valid)
        return result, is_valid

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        array, result, valid, *parameters = ctx.saved_tensors
        inputs, needed = [array, *parameters], ctx.needs_input_grad[2:]
        if torch.is_grad_enabled():  # a second derivative will follow
            values, _ = getattr(ctx.formulas, ctx.method)(array, parameters)
            wanted = [x for x, is_needed in zip(inputs, needed, strict=True) if is_needed]
            found = iter(torch.autograd.grad(values, wanted, gradients[0], create_graph=True, allow_unused=True))
            return None, None, *(next(found) if is_needed else None for is_needed in needed)
        model = numpy_model(parameters, ctx.formulas.model.name)
        points = array if ctx.method == "project" else result
        by_array, by_parameters = jacobian_products(model, ctx.method, points, valid, gradients[0])
        parts = torch.from_numpy(by_parameters).split([parameter.numel() for parameter in parameters])
        shaped = (part.reshape(x.shape).to(x.dtype) for part, x in zip(parts, parameters, strict=True))
        return None, None, torch.from_numpy(by_array).reshape(array.shape).to(array.dtype), *shaped


def fill_map(
    source: CameraModel,
    target: CameraModel,
    source_from_target: Tensor,
    covers: Callable[[NDArray[Any], NDArray[Any]], NDArray[np.bool_]],
    pixels: Tensor,
    valid: Tensor,
) -> None:
    """Compute the pixels of the source that the pixels of a view show, and where there are any.

    Parameters
    ----------
    source, target
        The cameras of the image and of the view.
    source_from_target
        (3, 3) rotation of bearings.
    covers
        Returns which columns and rows of the source are in its image.
    pixels, valid
        (height, width, 2) and (height, width), which are filled.
    """
    from omnisight.models._kernels import compiled  # imports numba, which takes a quarter of a second

    loop, kernels = compiled("map_view", target.name, source.name), (target.kernel, source.kernel)
    rotation = np.ascontiguousarray(source_from_target.detach().numpy(), dtype=float)
    filled, covered = pixels.numpy(), valid.numpy()
    u, v = np.empty(covered.shape, filled.dtype), np.empty(covered.shape, filled.dtype)

    def compute(first: int, last: int) -> None:
        for top in range(first, last, BAND_ROWS):
            rows = slice(top, min(top + BAND_ROWS, last))
            loop(*kernels, rotation, u, v, rows.start, rows.stop)
            filled[rows, :, 0], filled[rows, :, 1] = u[rows], v[rows]
            covered[rows] = covers(u[rows], v[rows])

    parallel_for(compute, len(covered), BAND_ROWS)


def jacobian_products(
    model: CameraModel, method: Method, points: Tensor, valid: Tensor, gradient: Tensor
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the products of a gradient with the derivatives by points (N, 3) or pixels (N, 2), and by parameters (P,).

    Parameters
    ----------
    model
        The camera model.
    method
        Name of the function that is differentiated.
    points, valid
        (..., 3) points, or the bearings of the pixels, and (...) which are valid: the derivatives of others are 0.
    gradient
        (..., 2) by pixels, or (..., 3) by bearings.
    """
    flat = points.detach().numpy().reshape(-1, 3)
    given, use = gradient.numpy().reshape(len(flat), -1), valid.numpy().ravel()
    by_array, by_parameters = np.zeros((len(flat), 3 if method == "project" else 2)), np.zeros(model.params.size)
    with np.errstate(all="ignore"):
        for start in range(0, len(flat), BLOCK):
            rows = slice(start, start + BLOCK)
            rows = rows if use[rows].all() else start + np.flatnonzero(use[rows])
            g = given[rows].T.astype(float)
            _, _, by_point, by_params = model.derivatives(flat[rows].astype(float))
            if method == "project":
                by_pixel = g
                by_array[rows] = np.einsum("kan,an->nk", by_point.T, g)
            else:
                # By the implicit function theorem: the gradient by the pixel is (J J^T)^-1 J g, J = by_point.
                by_pixel = -_solve_normal(by_point.T, g)
                by_array[rows] = -by_pixel.T
            by_parameters += _finite(by_params.T).reshape(len(by_parameters), -1) @ _finite(by_pixel).ravel()
    return _finite(by_array), by_parameters


def _finite(derivatives: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return derivatives with 0 in place of those that do not exist, such as at the poles of panoramas."""
    is_finite = np.isfinite(derivatives)
    return derivatives if is_finite.all() else np.where(is_finite, derivatives, 0.0)


def _solve_normal(j: NDArray[np.float64], g: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (J J^T)^-1 J g (2, n) of the transposed Jacobians j (3, 2, n) and gradients g (3, n)."""
    a, b, c = (np.einsum("kn,kn->n", j[:, p], j[:, q]) for p, q in ((0, 0), (0, 1), (1, 1)))
    u, v = np.einsum("kan,kn->an", j, g)
    return np.stack([c * u - b * v, a * v - b * u]) / (a * c - b * b)
