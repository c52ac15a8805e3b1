"""The functions of elementwise formulas for tensors."""

from functools import lru_cache
from typing import Any

import torch
from torch._subclasses import FakeTensor
from torch.autograd import forward_ad

from omnisight.models._elementwise import LIBRARIES, NumpyFunctions

# The pass with gradients must not reject a point that the pass without has accepted, so its limits are wider.
RELAXATION = 100.0


def is_traced(x: Any) -> bool:
    """Return whether values of a tensor cannot be read: while it is compiled, and in `torch.func`."""
    functorch: Any = torch._C._functorch  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
    return torch.compiler.is_compiling() or functorch.is_functorch_wrapped_tensor(x) or isinstance(x, FakeTensor)


def is_transformed() -> bool:
    """Return whether `torch.compile`, `torch.func` or `torch.autograd.forward_ad` is at work on any tensors."""
    functorch: Any = torch._C._functorch  # pyright: ignore[reportPrivateUsage, reportAttributeAccessIssue]
    level = forward_ad._current_level  # pyright: ignore[reportPrivateUsage]
    return torch.compiler.is_compiling() or level >= 0 or functorch.peek_interpreter_stack() is not None


def has_forward_derivative(x: torch.Tensor) -> bool:
    """Return whether a tensor has a tangent of `torch.autograd.forward_ad`."""
    return forward_ad.unpack_dual(x).tangent is not None


def has_gradient(*tensors: torch.Tensor) -> bool:
    """Return whether backward derivatives by any of the tensors are recorded."""
    return torch.is_grad_enabled() and any(x.requires_grad for x in tensors)


def has_derivative(x: torch.Tensor) -> bool:
    """Return whether derivatives by a tensor are recorded, backward or forward."""
    return has_gradient(x) or has_forward_derivative(x)


def constant(values: tuple[Any, ...], like: torch.Tensor) -> torch.Tensor:
    """Return numbers as a tensor like another, which is kept: a copy to a GPU waits for it."""
    if torch.compiler.is_compiling() or torch.is_inference_mode_enabled():
        return torch.tensor(values, dtype=like.dtype, device=like.device)
    return _kept(values, like.dtype, like.device)


@lru_cache(maxsize=256)
def _kept(values: tuple[Any, ...], dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    return torch.tensor(values, dtype=dtype, device=device)


class TensorFunctions(NumpyFunctions):
    """The functions of `models._elementwise` for tensors, with finite derivatives where those of torch are NaN."""

    where, absolute, arcsinh, cosh, tanh = torch.where, torch.abs, torch.asinh, torch.cosh, torch.tanh
    sin, cos, atan2 = torch.sin, torch.cos, torch.atan2

    @staticmethod
    def sqrt(x: Any) -> Any:
        if not torch.is_grad_enabled():
            return torch.sqrt(x)
        # The derivative of the clamp at 0 is 0, and that of the root of the smallest normal number is finite.
        return torch.sqrt(torch.clamp_min(x, torch.finfo(x.dtype).tiny))

    @staticmethod
    def signed_atan2(y: Any, x: Any) -> Any:
        if not torch.is_grad_enabled():
            return torch.atan2(y + 0.0, x)
        at_origin = (x == 0.0) & (y == 0.0)
        return torch.atan2(torch.where(at_origin, 0.0, y) + 0.0, torch.where(at_origin, 1.0, x))

    @staticmethod
    def as_index(x: Any) -> Any:
        return torch.nan_to_num(x).long()

    @staticmethod
    def any(condition: Any) -> Any:
        return is_traced(condition) or bool(torch.any(condition))

    @staticmethod
    def has_derivatives(x: Any) -> bool:
        return torch.is_grad_enabled() or is_traced(x)

    @staticmethod
    def without_gradient(x: Any) -> Any:
        return x.detach()

    @staticmethod
    def rounding(x: Any) -> float:
        eps = torch.finfo(x.dtype).eps
        return RELAXATION * eps if torch.is_grad_enabled() else eps


LIBRARIES[torch.Tensor] = TensorFunctions
