"""NumPy's compiled loops and the Jacobians of the models, as functions of torch on the CPU.

The loops compute a million points in the time of two elementwise operations of torch. The products of a gradient with
the Jacobians are computed in blocks that stay in the cache, while differentiation of the formulas keeps a hundred
intermediate results of all points.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from omnisight.models import CameraModel
from omnisight.parallel import parallel_for
from omnisight.torch.formulas import BoundFormula, BoundMap, Bounds, Method

# Points whose Jacobians are computed at once.
BLOCK = 4096
# Rows of a map that are computed at once.
BAND_ROWS = 8


def values(function: BoundFormula, array: Tensor) -> tuple[Tensor, Tensor]:
    """Return pixels or bearings and their validity."""
    found, valid = getattr(function.numpy_model, function.formula.method)(array.detach().numpy())
    return torch.from_numpy(found).to(array.dtype), torch.from_numpy(valid)


def gradients(
    function: BoundFormula, array: Tensor, values: Tensor, valid: Tensor, gradient: Tensor
) -> tuple[Tensor, ...]:
    """Return the gradients by the points or pixels and by each parameter, of that by the values."""
    method, parameters = function.formula.method, function.parameters
    points = array if method == "project" else values
    by_array, by_parameters = jacobian_products(function.numpy_model, method, points, valid, gradient)
    parts = torch.from_numpy(by_parameters).split([parameter.numel() for parameter in parameters])
    shaped = (part.reshape(x.shape).to(x.dtype) for part, x in zip(parts, parameters, strict=True))
    return torch.from_numpy(by_array).reshape(array.shape).to(array.dtype), *shaped


def view_map(view: BoundMap) -> tuple[Tensor, Tensor]:
    """Return the pixels (..., h, w, 2) of a source that the pixels of a view show, and where there are any."""
    from omnisight.models._kernels import compiled  # imports numba, which takes a quarter of a second

    source, target, rotation = view.project.numpy_model, view.unproject.numpy_model, view.rotation
    loop, kernels = compiled("map_view", target.name, source.name), (target.kernel, source.kernel)
    shape = *rotation.shape[:-2], *view.size[::-1]
    pixels, valid = rotation.new_empty(*shape, 2), rotation.new_empty(shape, dtype=torch.bool)
    for index in np.ndindex(rotation.shape[:-2]):
        matrix = np.ascontiguousarray(rotation[index].detach().numpy(), dtype=float)
        _fill(partial(loop, *kernels, matrix), view.bounds, pixels[index].numpy(), valid[index].numpy())
    return pixels, valid


def _fill(loop: Callable[..., None], bounds: Bounds, pixels: NDArray[Any], valid: NDArray[np.bool_]) -> None:
    u, v = np.empty(valid.shape, pixels.dtype), np.empty(valid.shape, pixels.dtype)

    def compute(first: int, last: int) -> None:
        for top in range(first, last, BAND_ROWS):
            rows = slice(top, min(top + BAND_ROWS, last))
            loop(u, v, rows.start, rows.stop)
            pixels[rows, :, 0], pixels[rows, :, 1] = u[rows], v[rows]
            valid[rows] = bounds.contain(u[rows], v[rows])

    parallel_for(compute, len(valid), BAND_ROWS)


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
