"""Options of `compass`. This module imports nothing heavy, because the command line imports it for its help."""

from dataclasses import dataclass
from typing import Literal

from omnisight.choices import Options


@dataclass(frozen=True)
class CompassOptions(Options):
    """Options of `compass`.

    Attributes
    ----------
    up
        Where the world's up is in the images of a camera: "top" of the image; "back", for a camera that looks down or
        into a mirror above it; "front", for one that looks up. By default "back" for a mirror camera, "top" for others.
    name
        Name of the camera in a file of several, such as a rig.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    up: Literal["top", "back", "front"] | None = None
    name: str | None = None
    scale_camera: bool = False
    apply_exif: bool = False
