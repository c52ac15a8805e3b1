"""Options of the capture of calibration images; their fields are options of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass

from omnisight.pipeline.detection.detect_options import DetectOptions


@dataclass(frozen=True, kw_only=True)
class CaptureOptions(DetectOptions):
    """Options of the capture of calibration images.

    Attributes
    ----------
    pattern
        Inner corners of the checkerboard, columns x rows: a board of 9x7 squares has 8x6. It, the squares or a target
        is needed.
    images
        Least number of images.
    coverage
        Share of the visible directions with corners, percent, at which the capture ends.
    """

    images: int = 12
    coverage: float = 90.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        super().__post_init__()
        if self.images < 3:
            raise ValueError(f"--images must be 3 or more, got {self.images}")
        if not 1 <= self.coverage <= 100:
            raise ValueError(f"--coverage must be between 1 and 100 percent, got {self.coverage:g}")
