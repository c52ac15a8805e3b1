"""The functions of the kernels of a GPU on the CPU, without compilation."""

import torch

from omnisight.torch import fused_kernels

KERNELS = "values_kernel", "gradients_kernel", "map_kernel", "remap_kernel"


def run_uncompiled_kernels(monkeypatch):
    """Evaluate the functions of cameras by those of the kernels."""
    monkeypatch.setattr("omnisight.torch.camera.fast_code", lambda *_: fused_kernels)
    monkeypatch.setattr(torch, "compile", lambda function, **_: function)
    monkeypatch.setattr(fused_kernels, "_compiled", lambda function, *_: function)
    for kernel in map(fused_kernels.__dict__.get, KERNELS):
        monkeypatch.setattr(fused_kernels, kernel.__name__, kernel.__wrapped__)
