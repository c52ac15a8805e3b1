"""Options of epipolar geometry and stereo.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omnisight.choices import Options

# Above, the parallax is less than three times its standard deviation, and the error of a distance is not symmetric.
MAX_RELATIVE_SIGMA = 0.33


@dataclass(frozen=True)
class EpipolarOptions(Options):
    """Options of `epipolar`.

    Attributes
    ----------
    mask
        Image that is white where keypoints are wanted (in a PBM file: 1).
    mask_b
        Mask of the second image; by default that of the first, if both images are of the same camera.
    name
        Name of the camera in a file of several, such as a rig.
    name_b
        Name of the camera of the second image; by default that of the first, if both are in the same file.
    features
        Kind of the keypoints: sift is accurate, orb is fast, xfeat is learned and needs `omnisight[learned]`.
    max_keypoints
        Number of keypoints per image; the strongest are used.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation.
    seed
        Seed of the random search.
    """

    mask: Path | None = None
    mask_b: Path | None = None
    name: str | None = None
    name_b: str | None = None
    features: Literal["sift", "orb", "xfeat"] = "sift"
    max_keypoints: int = 4000
    scale_camera: bool = False
    apply_exif: bool = False
    seed: int = 0


@dataclass(frozen=True)
class StereoOptions(Options):
    """Options of `stereo`.

    Attributes
    ----------
    cameras
        Names of the left and the right camera in the rig, such as front,rear; needed if the rig has more than two.
    min_distance
        Smallest distance of the scene, in the unit of the rig; by default three baselines. A smaller one takes more
        time. Nearer objects have no or wrong distances.
    max_sigma
        Largest standard deviation of a distance, relative to it; pixels with a larger one have no distance.
    mask_left
        Image that is white where pixels are used (in a PBM file: 1).
    mask_right
        Mask of the right image.
    scale_camera
        Scale the cameras, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation.
    seed
        Seed of the random search for the pose that checks the rig.
    """

    cameras: str | None = None
    min_distance: float | None = None
    max_sigma: float = 0.1
    mask_left: Path | None = None
    mask_right: Path | None = None
    scale_camera: bool = False
    apply_exif: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.max_sigma <= MAX_RELATIVE_SIGMA:
            raise ValueError(f"--max-sigma is {self.max_sigma:g}; choose one above 0 and up to {MAX_RELATIVE_SIGMA}")
