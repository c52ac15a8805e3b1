"""Files of views, with the tags of their photo, and those of a sphere."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images.gpano import SpherePart, with_gpano
from omnisight.images.view_tags import with_view_tags
from omnisight.images.write import encode_image
from omnisight.models.equirectangular import Equirectangular


def encode_view(
    view: NDArray[Any], name: str, target: Camera, tags: bytes, *, heading: float | None = None, is_level: bool = False
) -> bytes:
    """Return the bytes of an image file of a view, or of a stitched sphere.

    Parameters
    ----------
    view
        The view, (H, W) or (H, W, 3).
    name
        Name of the file.
    target
        Camera of the view; JPEG files of equirectangular ones get GPano tags.
    tags
        Those of the photo, of `omnisight.images.view_tags`.
    heading, is_level
        As of `omnisight.images.gpano.with_gpano`.
    """
    data, part = encode_image(view, name), sphere_part(target)
    if part is not None and Path(name).suffix.lower() in (".jpg", ".jpeg"):
        data = with_gpano(data, target.size, part=part, heading=heading, is_level=is_level)
    return with_view_tags(data, tags)


def sphere_part(target: Camera) -> SpherePart | None:
    """Return the part of a whole sphere that a camera shows; None if it is not equirectangular."""
    model = target.model
    if not isinstance(model, Equirectangular):
        return None
    width, height = round(2 * np.pi * float(model.fx)), round(np.pi * float(model.fy))
    return SpherePart(
        (width, height), (round((width - 1) / 2 - float(model.cx)), round((height - 1) / 2 - float(model.cy)))
    )


def is_whole_sphere(target: Camera) -> bool:
    """Return whether a camera is equirectangular and shows all directions."""
    return sphere_part(target) == SpherePart(target.size)
