"""The camera and the rotations of a view."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.pipeline.views.view_options import DEFAULT_FOV_DEG, ViewOptions
from omnisight.views.cube import CUBE_FACES, cube_rotation
from omnisight.views.view_cameras import (
    MAX_SIDE_PX,
    cube_face,
    cylinder,
    fisheye,
    mercator,
    panini,
    perspective,
    planet,
    sphere,
)

Array = NDArray[np.float64]

PANORAMA_VIEWS = {"cylinder": cylinder, "mercator": mercator, "sphere": sphere}


def view_target(options: ViewOptions) -> tuple[Camera, list[Array]]:
    """Return the camera of a view and target_from_source: one rotation, or one for each face of a cube."""
    rotation, size, to = options.view_from_source, options.size, options.to or "perspective"
    if size is not None and not 0 < min(size) <= max(size) <= MAX_SIDE_PX:
        raise ValueError(f"--size must be from 1x1 to {MAX_SIDE_PX}x{MAX_SIDE_PX} px, got {size[0]}x{size[1]}")
    fov = DEFAULT_FOV_DEG.get(to, 0.0) if options.fov is None else options.fov
    side = min(size) if size else 1024
    if to in PANORAMA_VIEWS:
        ranges = {"elevation": options.elevation, "azimuth": options.azimuth}
        given: Any = {name: limits for name, limits in ranges.items() if limits is not None}
        return PANORAMA_VIEWS[to](size[0] if size else 2048, **given), [rotation]
    match to:
        case "perspective":
            return perspective(size or (1280, 720), fov), [rotation]
        case "panini":
            return panini(size or (1280, 720), fov), [rotation]
        case "planet":
            return planet(side, fov), [rotation]
        case "fisheye":
            return fisheye(side, fov, options.projection), [rotation]
        case _:
            return cube_face(side), [cube_rotation(face, rotation) for face in CUBE_FACES]
