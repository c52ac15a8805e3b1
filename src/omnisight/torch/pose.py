"""Rigid motions as modules."""

import numpy as np
import torch
from torch import Tensor, nn

from omnisight.geometry.pose import Pose as NumpyPose


class Pose(nn.Module):
    """A rigid motion b_from_a that an optimizer can move: x_b = exp(w) R x_a + t.

    The parameters are the rotation vector `w` (3,) (radians), which starts at 0, and the translation `t` (3,).

    Parameters
    ----------
    pose
        The motion from which it starts.
    dtype, device
        Type and device of the parameters.
    """

    def __init__(
        self,
        pose: NumpyPose | None = None,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__()
        start = NumpyPose() if pose is None else pose
        self.register_buffer("start", torch.tensor(start.rotation, dtype=dtype, device=device))
        self.w = nn.Parameter(torch.zeros(3, dtype=dtype, device=device))
        self.t = nn.Parameter(torch.tensor(start.translation, dtype=dtype, device=device))

    @property
    def rotation(self) -> Tensor:
        """The rotation matrix (3, 3)."""
        zero = torch.zeros_like(self.w[0])
        x, y, z = self.w
        cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
        return torch.linalg.matrix_exp(cross) @ self.start

    def forward(self, points: Tensor) -> Tensor:
        """Map points (..., 3) of the frame a to the frame b."""
        return points @ self.rotation.to(points.dtype).T + self.t.to(points.dtype)

    def numpy(self) -> NumpyPose:
        """Return the NumPy pose with the current values of the parameters."""
        with torch.no_grad():
            return NumpyPose(*(np.asarray(x.double().cpu()) for x in (self.rotation, self.t)))
