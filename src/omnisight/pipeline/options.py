"""Options of the pipeline functions; their fields are the options of the commands.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from omnisight.calibration.estimation_options import EstimationOptions
from omnisight.choices import Options
from omnisight.pipeline.batch.batch_options import BatchOptions
from omnisight.pipeline.image_options import ImageOptions

if TYPE_CHECKING:
    from omnisight.targets import Board

# Each proposal assumes that all earlier ones were taken as planned.
MAX_PROPOSALS = 20
# Above, the parallax is less than three times its standard deviation, and the error of a distance is not symmetric.
MAX_RELATIVE_SIGMA = 0.33


@dataclass(frozen=True, kw_only=True)
class DetectOptions(ImageOptions):
    """Options that describe the board and how images are read.

    Attributes
    ----------
    target
        File that describes the board, instead of pattern and square: written by `omnisight target`, or a target
        file of Kalibr (YAML).
    """

    target: Path | None = None

    @property
    def board(self) -> "Board | None":
        """The specified board; None if it is to be determined from the images.

        Raises
        ------
        ValueError
            If it cannot be read, or is specified twice.
        """
        from omnisight.targets.target_file import load_board

        if self.target is None:
            return self.checkerboard
        self.check_one_board()
        return load_board(self.target)


@dataclass(frozen=True, kw_only=True)
class SourceOptions(DetectOptions):
    """Options that describe the board, and how images or corner files are read.

    Attributes
    ----------
    image_size
        Width and height of the images of a corner file, such as 1280x800, if the file does not contain them.
    which
        Name of the camera, if a corner file holds several.
    """

    image_size: str | None = None
    which: str | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) of the images that corners are from, px."""
        if self.image_size is None:
            return None
        sides = [side.strip() for side in self.image_size.lower().split("x")]
        if len(sides) != 2 or not all(side.isdigit() and int(side) > 0 for side in sides):
            raise ValueError(f"--image-size must be WIDTHxHEIGHT in px, such as 1280x720, got {self.image_size!r}")
        return int(sides[0]), int(sides[1])


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions(SourceOptions, EstimationOptions):
    """Options of `calibrate`.

    Attributes
    ----------
    model
        Camera model: ocam, mei, kannala_brandt, double_sphere, eucm, unified ...; auto fits several and selects the one
        with the lowest held-out error; axial is a non-central camera whose entrance pupil shifts along the axis.
    start
        Camera file of a lens and mirror as designed, such as `omnisight design mirror --camera` writes for a
        non-central system; its pose and parameters are refined. Needs the size of the board's squares.
    method
        Calibration method: omnisight, or ocamcalib, Scaramuzza's original method, for comparison. The errors of both
        are printed.
    drop
        Name of an image to leave out, as in the table; may be repeated.
    force
        Calibrate from fewer than three images, or although most of them show another board.
    """

    model: str = "auto"
    start: Path | None = None
    method: Literal["omnisight", "ocamcalib"] = "omnisight"
    drop: tuple[str, ...] = ()
    force: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.model != "auto":  # `omnisight --help` builds the default options, and must not import numpy
            from omnisight.extensions import unknown_name
            from omnisight.models import model_names
            from omnisight.optics.models import ray_model_names

            if self.model not in (known := ("auto", *model_names(), *ray_model_names())):
                raise ValueError(unknown_name("camera model", self.model, known))
        if self.start is not None and self.model != "auto":
            raise ValueError(f"--start {self.start} contains its model: leave out --model {self.model}")
        if self.is_noncentral and self.method == "ocamcalib":
            raise ValueError("--method ocamcalib calibrates central cameras: leave out --model axial and --start")

    @property
    def is_noncentral(self) -> bool:
        """Whether a non-central camera is requested."""
        return self.start is not None or self.model == "axial"

    @property
    def is_auto(self) -> bool:
        """Whether the central model is selected automatically."""
        return self.model == "auto" or self.is_noncentral


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(SourceOptions):
    """Options of `evaluate`.

    Attributes
    ----------
    threshold
        Huber threshold, px: longer residuals have less weight in the poses and in wRMS.
    flat
        Assume a flat board. Otherwise its warp is estimated with the poses, the same in all images.
    """

    threshold: float = 1.5
    flat: bool = False


@dataclass(frozen=True, kw_only=True)
class NextViewOptions(SourceOptions):
    """Options of `next_view`; without a pattern or target, the board is that of the camera's calibration.

    Attributes
    ----------
    count
        Number of images to propose, 1 to 20.
    name
        Name of the camera, if its file holds several, such as a rig.
    """

    count: int = 3
    name: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.count <= MAX_PROPOSALS:
            raise ValueError(f"count is {self.count}; choose 1 to {MAX_PROPOSALS} images to propose")


def check_options(options: object, expected: type) -> None:
    """Raise `ValueError` if options are not of the expected class."""
    if not isinstance(options, expected):
        raise ValueError(f"options must be {expected.__name__}(...), got {type(options).__name__}")


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
        Name of the camera of the second image; by default that of the first.
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
            raise ValueError(f"max_sigma is {self.max_sigma:g}; choose a value above 0 and up to {MAX_RELATIVE_SIGMA}")


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
            raise ValueError(f"window is {self.window}; choose at least 1 following image")
        if not self.fps > 0:
            raise ValueError(f"fps is {self.fps:g}; choose a positive number of images per second")
        if self.scale and self.positions:
            raise ValueError("positions determine the scale: leave scale out")
        if self.max_keypoints < 1:
            raise ValueError(f"max_keypoints is {self.max_keypoints}; choose a positive number")
