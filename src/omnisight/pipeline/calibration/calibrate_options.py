"""Options of the calibration of a camera.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from omnisight.calibration.estimation_options import EstimationOptions
from omnisight.pipeline.detection.detect_options import SourceOptions

# Each proposal assumes that all earlier ones were taken as planned.
MAX_PROPOSALS = 20


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
            raise ValueError(f"--count is {self.count}; choose 1 to {MAX_PROPOSALS} images to propose")
