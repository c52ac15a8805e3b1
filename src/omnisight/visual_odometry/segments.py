"""Segments of a trajectory: its parts between losses after which no known place was found."""

from collections.abc import Sequence
from dataclasses import dataclass

from omnisight.visual_odometry.frame_result import LostSegment, TrackedPose
from omnisight.visual_odometry.loop_result import Loop


@dataclass(frozen=True)
class Segment:
    """A part of the trajectory.

    Attributes
    ----------
    first, last
        Indices of its first and last frame with a pose.
    world
        Number of its world, from 0: segments with the same one have one scale, and their relative pose is measured. The
        place and the scale of a new world are extrapolated.
    """

    first: int
    last: int
    world: int


def trajectory_segments(
    trajectory: Sequence[TrackedPose], lost: Sequence[LostSegment], loops: Sequence[Loop]
) -> tuple[Segment, ...]:
    """Return the segments of a trajectory; those that a loop joins have the same world."""
    frames = [pose.frame for pose in trajectory]
    known, ends = set(frames), [each for each in lost if each.recovery == "new segment"]
    starts = sorted(each.last if each.last in known else each.last + 1 for each in ends)
    parts = [sum(start <= frame for start in starts) for frame in frames]
    part_of = dict(zip(frames, parts, strict=True))
    world = {part: number for number, part in enumerate(sorted(set(parts)))}
    for loop in loops:
        a, b = sorted((world[part_of[loop.first]], world[part_of[loop.last]]))
        world = {part: a if number == b else number for part, number in world.items()}
    numbers = {old: new for new, old in enumerate(sorted(set(world.values())))}
    runs = {part: [frame for frame in frames if part_of[frame] == part] for part in world}
    return tuple(Segment(run[0], run[-1], numbers[world[part]]) for part, run in runs.items())
