"""The loss of light towards the edge of a lens's image."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import angle_from_axis
from omnisight.models._cylindrical_projection import CylindricalProjection
from omnisight.simulation.camera_protocol import RenderableCamera

Array = NDArray[np.float64]

# No lens sees farther from its axis at the edge of its image: such an image is a panorama.
MAX_LENS_RAD = float(np.radians(170))
# Pixels per side sampled for the extent of a lens's image.
EXTENT_SAMPLES = 129


def lens_extent(
    camera: RenderableCamera, in_view: Callable[[Array], NDArray[np.bool_]]
) -> tuple[tuple[float, float], float] | None:
    """Return the principal point of a lens and the largest distance (px) from it in view; None for a panorama.

    Parameters
    ----------
    camera
        Of a mirror camera, the lens.
    in_view
        Return which bearings (..., 3) the camera shows.
    """
    u, v = (np.linspace(0, side - 1, min(side, EXTENT_SAMPLES)) for side in camera.size)
    pixels = np.stack(np.meshgrid(u, v), -1)
    bearings = camera.rays(pixels).bearings
    seen = in_view(bearings)
    edge = np.ones(seen.shape, np.bool_)
    edge[1:-1, 1:-1] = False
    model = getattr(camera, "model", None)
    is_panorama = (
        isinstance(model, CylindricalProjection) or (angle_from_axis(bearings[seen & edge]) > MAX_LENS_RAD).any()
    )
    if is_panorama or not seen.any():
        return None
    lens = getattr(model, "lens", model)
    cx, cy = (float(getattr(lens, key, (side - 1) / 2)) for key, side in zip(("cx", "cy"), camera.size, strict=True))
    return (cx, cy), max(float(np.linalg.norm(pixels[seen] - (cx, cy), axis=-1).max()), 1.0)
