"""Options of `doctor`; this module imports nothing heavy, because the command line imports it for its help."""

from dataclasses import dataclass
from pathlib import Path

from omnisight.display import Displayed


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(Displayed):
    """Options of the checks of a recording.

    Attributes
    ----------
    fps
        Images per second of a folder without times.csv (lines of name,seconds). A clip has its own times. By default
        10.
    mask
        Image that is white where the images may be used, such as without the vehicle.
    scale
        Scale the camera to the size of the images, if they were resized.
    images
        Number of images to examine, in runs of eight that are spread over the recording.
    """

    fps: float | None = None
    mask: Path | None = None
    scale: bool = False
    images: int = 240

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.fps is not None and not 0 < self.fps < float("inf"):
            raise ValueError(f"--fps must be positive, got {self.fps:g}")
        if self.images < 8:
            raise ValueError(f"--images must be at least 8, got {self.images}")
