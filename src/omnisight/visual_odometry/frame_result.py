"""Results of visual odometry."""

from dataclasses import dataclass
from typing import Literal

from omnisight.display import Displayed
from omnisight.geometry.pose import Pose

Motion = Literal["general", "rotation only"]


@dataclass(frozen=True, eq=False)
class TrackedPose(Displayed):
    """A pose of the trajectory.

    Attributes
    ----------
    frame
        Index of the frame in the sequence.
    seconds
        Its time.
    rig_from_world
        The pose. The world is the frame of the rig at the first frame.
    motion
        "rotation only" where the camera turned without moving, and its position is that of the frame before.
    """

    frame: int
    seconds: float
    rig_from_world: Pose
    motion: Motion = "general"


@dataclass(frozen=True)
class LostSegment(Displayed):
    """Frames whose pose is not known, or a frame after a cut.

    Attributes
    ----------
    first, last
        Indices of the frames. After a cut, the frame that shows another place is listed even if its pose is known.
    reason
        Why the poses are not known.
    recovery
        What followed: "tracking" and "relocalization" continue the map; "new segment" starts another one, whose place
        and scale are extrapolated; empty at the end of the sequence.
    """

    first: int
    last: int
    reason: str
    recovery: str = ""


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What is known of a frame after it was added.

    Attributes
    ----------
    frame, seconds
        Index in the sequence, and time.
    rig_from_world
        The pose; None while it is not known. Frames before the first parallax get theirs later, in the trajectory.
    tracked
        Number of patches that agree with the motion.
    is_keyframe
        Whether the window was extended by it.
    reason
        Why there is no pose; empty otherwise.
    """

    frame: int
    seconds: float
    rig_from_world: Pose | None
    tracked: int
    is_keyframe: bool = False
    reason: str = ""
