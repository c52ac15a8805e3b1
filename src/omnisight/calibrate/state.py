"""What a calibration solves for: a camera, where each board stands, and how the board is bent."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.views import BoardViews
from omnisight.models import CameraModel

Array = NDArray[np.float64]

# What a corner outside the model's domain costs, px: a large miss, but no reason to stop.
OUTSIDE = 100.0


@dataclass(frozen=True)
class State:
    """A camera model, where each board stands, and how the board is bent.

    Attributes
    ----------
    model
        The camera.
    rotations, translations
        cam_from_board (V, 3, 3) and (V, 3).
    warp
        (2,) how far the board's middle stands off the plane of its edges, bent across x and across y: z = warp . bows
        in the unit of the board, positive towards its back (`BoardViews.bows`).
    """

    model: CameraModel
    rotations: Array
    translations: Array
    warp: Array = field(default_factory=lambda: np.zeros(2))

    def points(self, views: BoardViews) -> tuple[Array, Array]:
        """Give the corners in the camera frame (N, 3), and only turned into it (N, 3)."""
        corners = views.points
        if self.warp.any():
            corners = corners + (views.bows @ self.warp)[:, None] * (0, 0, 1)
        turned = np.empty_like(corners)
        for rotation, rows in zip(self.rotations, views.groups, strict=True):
            turned[rows] = corners[rows] @ rotation.T
        return turned + self.translations[views.view_of_row], turned

    def part(self, views: NDArray[np.intp]) -> "State":
        """Give it for some of the views."""
        return replace(self, rotations=self.rotations[views], translations=self.translations[views])

    def residuals(self, views: BoardViews) -> Array:
        """Give projected minus seen pixels (N, 2), NaN where a corner lies outside the model's domain."""
        pixels, _ = self.model.project_numpy(self.points(views)[0])
        return pixels - views.pixels

    def lengths(self, views: BoardViews, roots: Array | None = None) -> Array:
        """Give the length (px) of each corner's residual (N,), times `roots` (N, 2, 2) if there are any.

        `OUTSIDE` outside the model's domain.
        """
        residuals = self.residuals(views)
        if roots is not None:
            residuals = np.einsum("nij,nj->ni", roots, residuals)
        length = np.linalg.norm(residuals, axis=1)
        # No less than a wrong corner may cost, or a camera would fold so as to lose those.
        across = float(np.linalg.norm(np.ptp(views.pixels, axis=0))) if len(length) else 0.0
        return np.where(np.isfinite(length), length, max(OUTSIDE, across))
