"""Cameras as modules of PyTorch: projections and remaps with derivatives, on any device.

Needs the extra `torch`: pip install 'omnisight[torch]'. `import omnisight` does not import it.
"""

try:
    import omnisight.torch.tensor_functions  # noqa: F401  # pyright: ignore[reportUnusedImport] -- formulas then take tensors
except ModuleNotFoundError as error:
    raise ImportError("omnisight.torch needs PyTorch: pip install 'omnisight[torch]'") from error

from omnisight.torch.camera import Camera
from omnisight.torch.pose import Pose
from omnisight.torch.sampling import sample

__all__ = ["Camera", "Pose", "sample"]
