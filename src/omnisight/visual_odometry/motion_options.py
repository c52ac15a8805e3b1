"""Options of visual odometry."""

from dataclasses import dataclass

from omnisight.display import Displayed


@dataclass(frozen=True, kw_only=True)
class MotionOptions(Displayed):
    """How motion is estimated.

    Attributes
    ----------
    patches
        Number of patches to track in the images of a frame.
    window
        Number of keyframes that are refined together.
    loops
        Close loops: places that were seen before correct the trajectory at the end. Keyframes are kept for it, and
        memory grows with their number.
    seed
        Seed of the random numbers: the same images and seed give the same trajectory.
    """

    patches: int = 400
    window: int = 15
    loops: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.patches < 50:
            raise ValueError(f"--patches must be at least 50, got {self.patches}")
        if self.window < 3:
            raise ValueError(f"--window must be at least 3 keyframes, got {self.window}")
