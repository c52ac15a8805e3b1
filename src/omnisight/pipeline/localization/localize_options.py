"""Options of `localize`.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path

from omnisight.choices import Options


@dataclass(frozen=True)
class LocalizeOptions(Options):
    """Options of `localize`.

    Attributes
    ----------
    name
        Name of the camera in a file of several.
    mask
        Image that is white where keypoints are wanted (in a PBM file: 1).
    max_keypoints
        Number of keypoints per image; the strongest are used.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    name: str | None = None
    mask: Path | None = None
    max_keypoints: int = 4000
    scale_camera: bool = False
    apply_exif: bool = False
