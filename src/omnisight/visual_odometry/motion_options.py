"""Options of visual odometry."""

from dataclasses import dataclass
from typing import Literal

from omnisight.choices import Options


@dataclass(frozen=True, kw_only=True)
class MotionOptions(Options):
    """How motion is estimated.

    Attributes
    ----------
    patches
        Number of patches to track in the images of a frame.
    window
        Number of keyframes that are refined together.
    loops
        Refine all keyframes together at the end, and close loops: places that were seen before correct the trajectory.
        Keyframes are kept for it, and memory grows with their number.
    motion
        How the camera moves: "car" if its z axis is that of a car that steers with its front wheels, where one pair
        of directions determines a motion instead of five, which tolerates more outliers; "general" otherwise.
    up
        Direction of the camera over the ground: "top" is level; "back" looks down, as below a mirror; "front" looks up.
    seed
        Seed of the random numbers: the same images and seed give the same trajectory.
    """

    patches: int = 400
    window: int = 15
    loops: bool = True
    motion: Literal["general", "car"] = "general"
    up: Literal["top", "back", "front"] = "top"
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers."""
        super().__post_init__()
        if self.patches < 50:
            raise ValueError(f"--patches must be at least 50, got {self.patches}")
        if self.window < 3:
            raise ValueError(f"--window must be at least 3 keyframes, got {self.window}")
