"""Results of the closing of loops."""

from dataclasses import dataclass, field

from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.frame_result import TrackedPose


@dataclass(frozen=True, eq=False)
class Loop(Displayed):
    """A place that was seen before.

    Attributes
    ----------
    first, last
        Indices of the frame that shows the place first, and of the one that returns to it.
    first_from_last
        Pose of the rig between them, in the unit of the trajectory at the first frame.
    scale
        Unit of the trajectory at the last frame, in that at the first one: 1 if the scale is known.
    matches, inliers
        Points of the first frame that were matched with the last one, and that agree with the pose.
    directions
        Share of the directions with points of the last frame in which some agree.
    """

    first: int
    last: int
    first_from_last: Pose
    scale: float
    matches: int
    inliers: int
    directions: float


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """A refined trajectory with closed loops; false if there are none.

    Attributes
    ----------
    trajectory
        Poses of the same frames as before, those of all keyframes refined together.
    loops
        The loops that agree with the trajectory and with each other.
    rejected
        Loops that do not.
    correction
        Largest displacement of a pose, in the unit of the trajectory.
    reason
        Why there is no loop; empty otherwise.
    """

    trajectory: tuple[TrackedPose, ...] = field(repr=False)
    loops: tuple[Loop, ...] = ()
    rejected: tuple[Loop, ...] = ()
    correction: float = 0.0
    reason: str = ""

    def __bool__(self) -> bool:
        return bool(self.loops)
