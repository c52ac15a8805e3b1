"""What a calibration solves for: a camera, where each board stands, and how the board is bent."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration._bundle_kernel import place, weighted_lengths
from omnisight.models import CameraModel
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# What a corner outside_cost the model's domain costs at least, px: a large miss, but no reason to stop.
MIN_OUTSIDE_COST_PX = 100.0


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
        in the unit of the board, positive towards its back (`Observations.bows`).
    """

    model: CameraModel
    rotations: Array
    translations: Array
    warp: Array = field(default_factory=lambda: np.zeros(2))

    def points(self, views: Observations) -> tuple[Array, Array]:
        """Give the corners in the camera frame (N, 3), and only turned into it (N, 3)."""
        return place(views.points, views.bows, self.warp, views.view_of_row, self.rotations, self.translations)

    def part(self, views: NDArray[np.intp]) -> "State":
        """Give it for some of the views."""
        return replace(self, rotations=self.rotations[views], translations=self.translations[views])

    def residuals(self, views: Observations) -> Array:
        """Give projected minus seen pixels (N, 2), NaN where a corner lies outside_cost the model's domain."""
        pixels, _ = self.model.project_numpy(self.points(views)[0])
        return pixels - views.pixels

    def lengths(self, views: Observations, roots: Array | None = None) -> Array:
        """Give the length (px) of each corner's residual (N,), times `roots` (N, 2, 2) if there are any.

        `outside_cost` outside_cost the model's domain.
        """
        return lengths(self.residuals(views), views, roots)


def lengths(residuals: Array, views: Observations, roots: Array | None = None) -> Array:
    """Give the lengths (px) of residuals (N, 2), times `roots` (N, 2, 2) if there are any; `outside_cost` for NaN."""
    return weighted_lengths(
        residuals, identity_weights(len(residuals)) if roots is None else roots, outside_cost(views)
    )


def identity_weights(count: int) -> Array:
    """Give the roots (N, 2, 2) of residuals that all count the same."""
    return np.tile(np.eye(2), (count, 1, 1))


def outside_cost(views: Observations) -> float:
    """Give what a corner costs, px, that a camera does not see."""
    # No less than a wrong corner may cost, or a camera would fold so as to lose those.
    return max(MIN_OUTSIDE_COST_PX, views.across)
