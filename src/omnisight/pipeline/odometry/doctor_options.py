"""Options of `doctor`; this module imports nothing heavy, because the command line imports it for its help."""

from dataclasses import dataclass
from pathlib import Path

from omnisight.pipeline.odometry.sequence_options import SequenceOptions


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(SequenceOptions):
    """Options of the checks of a recording.

    Attributes
    ----------
    mask
        Image that is white where the images may be used, such as without the vehicle.
    images
        Number of images to examine, in runs of eight that are distributed over the recording.
    """

    mask: Path | None = None
    images: int = 240

    def __post_init__(self) -> None:
        """Check the numbers."""
        super().__post_init__()
        if self.images < 8:
            raise ValueError(f"--images must be at least 8, got {self.images}")
