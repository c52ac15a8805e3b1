"""Images of a pair with their cameras and masks."""

from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import named_tuple_text
from omnisight.images import read_image

ImageSource = str | PathLike[str] | NDArray[Any]

# Keypoints below which an image has no texture: a pose needs at least eight matches.
MIN_KEYPOINTS = 8


class Photo(NamedTuple):
    """An image and its camera.

    Attributes
    ----------
    label
        Name of the image in messages.
    image
        (H, W), (H, W, 3) or (H, W, 4).
    camera
        The camera, of the size of the image.
    mask
        (H, W), where keypoints are wanted; None everywhere.
    """

    label: str
    image: NDArray[Any]
    camera: Camera
    mask: NDArray[np.bool_] | None

    __repr__ = named_tuple_text


def read_source(source: ImageSource, default_label: str, apply_exif: bool) -> tuple[str, NDArray[Any]]:
    """Return the name of an image in messages, and the image, read if it is a file."""
    if isinstance(source, np.ndarray):
        return default_label, source
    return str(source), read_image(Path(source), apply_exif=apply_exif)
