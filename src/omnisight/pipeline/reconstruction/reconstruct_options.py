"""Options of structure from motion.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omnisight.pipeline.batch.batch_options import BatchOptions


@dataclass(frozen=True)
class ReconstructOptions(BatchOptions):
    """Options of `reconstruct`.

    Attributes
    ----------
    engine
        What estimates the initial poses from the relative ones: omnisight, or COLMAP's incremental or global mapper,
        which needs `omnisight[colmap]`. Features, matches, points and bundle adjustment are the same.
    pairs
        Pairs of images to match: all; sequential, for images in the order of a path: those at most `window` apart and,
        of more than 40 images, the 10 most similar ones; auto: those whose strongest keypoints match, or, of more than
        40 images, the 20 most similar ones, and sequential for a clip.
    window
        Number of following images that each image is matched with.
    fps
        Images per second that are used of a video clip or a ROS bag: the sharpest of each interval.
    topic
        Image topic of a ROS bag, such as /cam0/image_raw; it may be left out if only one topic has images.
    extrinsics
        Poses of the cameras on the rig: fixed, refined from those of the rig file, or unknown, for several cameras that
        are rigidly connected. By default those of a rig are fixed, and several cameras without a rig are independent.
    refine_camera
        Refine the cameras with the poses; the covariance of their calibration is the prior.
    scale
        Two images and the distance between their cameras, such as first.jpg last.jpg 3.2m.
    positions
        Positions of images, for a model in metres: exif for the GPS tags of the images, or a CSV file with the columns
        name,x,y,z (metres) or name,latitude,longitude,altitude (degrees, metres).
    name
        Name of the camera in a file of several.
    mask
        Image that is white where keypoints are wanted, in all images (in a PBM file: 1); or a folder with a mask for
        each camera, which has its name.
    max_keypoints
        Number of keypoints per image; the strongest are used.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation, and frames as the clip specifies for display.
    """

    engine: Literal["omnisight", "colmap", "colmap-global"] = "omnisight"
    pairs: Literal["auto", "all", "sequential"] = "auto"
    window: int = 10
    fps: float = 2.0
    topic: str | None = None
    extrinsics: Literal["fixed", "refined", "unknown"] | None = None
    refine_camera: bool = False
    scale: tuple[str, str, str] | None = None
    positions: str | None = None
    name: str | None = None
    mask: Path | None = None
    max_keypoints: int = 4000
    scale_camera: bool = False
    apply_exif: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window < 1:
            raise ValueError(f"--window is {self.window}; choose at least 1 following image")
        if not self.fps > 0:
            raise ValueError(f"--fps is {self.fps:g}; choose a positive number of images per second")
        if self.scale and self.positions:
            raise ValueError("--positions determine the scale: leave --scale out")
        if self.max_keypoints < 1:
            raise ValueError(f"--max-keypoints is {self.max_keypoints}; choose a positive number")
