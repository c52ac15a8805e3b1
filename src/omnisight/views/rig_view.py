"""View of a rig: its images as those of one camera at the origin of the rig frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.camera import Camera
from omnisight.rig import Rig
from omnisight.views.image_size import check_size
from omnisight.views.surround_remapper import SurroundRemapper

Image = NDArray[Any]

# Width of the transition at seams, as a share of the larger side of the view: seven degrees of a sphere.
FEATHER_SHARE = 0.02
# Distance of a scene at infinity, in the unit of the rig: the parallax of a baseline of 1 is 1e-9 rad.
FAR = 1e9


def remap_rig(
    images: Sequence[Image],
    rig: Rig,
    target: Camera,
    target_from_rig: ArrayLike | None = None,
    *,
    distance: float = float("inf"),
) -> Image:
    """Remap simultaneous images of a rig to a camera at its origin; see `remap`.

    Parameters
    ----------
    images
        (H, W) or (H, W, 3) of each camera, in their order, of one type: uint8, uint16, float32 or float64.
    rig
        The rig; its cameras may be of any model, central or not.
    target
        The camera of the view.
    target_from_rig
        (3, 3) rotation of bearings from the rig to the view; the identity by default.
    distance
        Distance of the scene from the origin of the rig frame, in its unit.

    Raises
    ------
    ValueError
        If the number or the size of the images is not that of the cameras, or the distance is not positive.
    """
    if len(images) != len(rig):
        raise ValueError(f"{len(images)} images, and the rig has {len(rig)} cameras: {', '.join(rig.names)}")
    for name, camera, image in zip(rig.names, rig.cameras, images, strict=True):
        check_size((image.shape[1], image.shape[0]), camera.size, name)
    if not distance > 0:
        raise ValueError(f"the distance of the scene must be positive, got {distance}")
    rotation = np.eye(3) if target_from_rig is None else np.asarray(target_from_rig, float)
    grid = np.stack(np.meshgrid(np.arange(target.width), np.arange(target.height)), -1)
    bearings, _ = target.unproject(grid.astype(float))
    points = min(distance, FAR) * (bearings @ rotation)
    remapper = SurroundRemapper(rig, points, feather_px=FEATHER_SHARE * max(target.size))
    dtype = images[0].dtype
    view = remapper([image.astype(np.float32) if dtype == np.float64 else image for image in images]).astype(dtype)
    return view[..., 0] if all(image.ndim == 2 for image in images) else view
