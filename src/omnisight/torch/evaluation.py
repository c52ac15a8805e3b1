"""The functions of a camera with first derivatives by the fastest code for the device of the points.

Compiled loops run on the CPU, and after `Camera.compile` fused kernels on a GPU. Both have products with the first
derivatives; higher ones are those of the formulas. Everything else runs the formulas: `torch.compile`, `torch.func` and
forward derivatives.
"""

from typing import Any

import torch
from torch import Tensor

from omnisight.torch import compiled_loops, fused_kernels
from omnisight.torch.formulas import BoundFormula
from omnisight.torch.tensor_functions import is_transformed


def fast_code(fused: bool, *tensors: Tensor) -> Any:
    """Return the module that evaluates functions of these inputs, or None for the formulas; `fused` allows kernels."""
    if is_transformed():
        return None
    if all(x.is_cpu for x in tensors):
        return compiled_loops
    return fused_kernels if fused and all(x.is_cuda for x in tensors) else None


class Evaluation(torch.autograd.Function):
    """A projection or unprojection whose first derivatives are computed without those of each operation."""

    @staticmethod
    def forward(ctx: Any, code: Any, function: BoundFormula, array: Tensor, *_: Tensor) -> tuple[Tensor, Tensor]:
        values, valid = code.values(function, array)
        ctx.code, ctx.formula = code, function.formula
        ctx.save_for_backward(array, values, valid, *function.parameters)
        ctx.mark_non_differentiable(valid)
        return values, valid

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        array, values, valid, *parameters = ctx.saved_tensors
        function = BoundFormula(ctx.formula, parameters)
        if not torch.is_grad_enabled():
            return None, None, *ctx.code.gradients(function, array, values, valid, gradients[0])
        # A second derivative will follow.
        inputs, needed = [array, *parameters], ctx.needs_input_grad[2:]
        values, _ = function.evaluate(array)
        wanted = [x for x, is_needed in zip(inputs, needed, strict=True) if is_needed]
        found = iter(torch.autograd.grad(values, wanted, gradients[0], create_graph=True, allow_unused=True))
        return None, None, *(next(found) if is_needed else None for is_needed in needed)
