"""The functions of the kernels of a GPU on the CPU, without compilation."""

import torch

from omnisight.torch import Camera, compiled_loops, fused_kernels

KERNELS = "values_kernel", "gradients_kernel", "map_kernel", "remap_kernel"


def run_uncompiled_kernels(monkeypatch):
    """Evaluate the functions of cameras that are made from now on by those of the kernels."""
    initialize = Camera.__init__

    def initialize_compiled(camera, *arguments, **options):
        initialize(camera, *arguments, **options)
        camera.compile()

    monkeypatch.setattr(Camera, "__init__", initialize_compiled)
    monkeypatch.setattr(
        "omnisight.torch.camera.fast_code", lambda is_fused, *_: fused_kernels if is_fused else compiled_loops
    )
    monkeypatch.setattr(torch, "compile", lambda function, **_: function)
    monkeypatch.setattr(fused_kernels, "_compiled", lambda function, *_: function)
    for kernel in map(fused_kernels.__dict__.get, KERNELS):
        monkeypatch.setattr(fused_kernels, kernel.__name__, kernel.__wrapped__)
