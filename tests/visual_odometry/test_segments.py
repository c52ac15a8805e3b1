"""Segments of a trajectory, and which of them loops join."""

import omnisight as om
from omnisight.pipeline.odometry.odometry_scale import ScaledTrajectory
from omnisight.visual_odometry.frame_result import LostSegment, TrackedPose
from omnisight.visual_odometry.loop_result import Loop
from omnisight.visual_odometry.segments import Segment, trajectory_segments

# Frames 20 to 24 are lost; at 40 the clip is cut; a loss that ended by tracking separates nothing.
FRAMES = [*range(20), *range(25, 30), *range(32, 60)]
LOST = (
    LostSegment(20, 24, "covered", "new segment"),
    LostSegment(30, 31, "covered", "tracking"),
    LostSegment(40, 40, "another place", "new segment"),
)
TRAJECTORY = [TrackedPose(frame, 0.1 * frame, om.Pose()) for frame in FRAMES]


def test_segments_end_where_no_known_place_was_found():
    found = trajectory_segments(TRAJECTORY, LOST, ())
    assert found == (Segment(0, 19, 0), Segment(25, 39, 1), Segment(40, 59, 2))


def test_loops_join_the_worlds_of_segments():
    loop = Loop(3, 45, om.Pose(), 1.1, 40, 30, 0.8)
    assert [part.world for part in trajectory_segments(TRAJECTORY, LOST, [loop])] == [0, 1, 0]


def test_without_poses_there_are_no_segments():
    assert trajectory_segments([], LOST, ()) == ()


def test_the_scale_of_segments_that_loops_join_to_a_measured_one_is_not_extrapolated():
    loop = Loop(3, 45, om.Pose(), 1.1, 40, 30, 0.8)
    for loops, count in (((), "2 of 3"), ((loop,), "1 of 2")):
        segments = trajectory_segments(TRAJECTORY, LOST, loops)
        assert ScaledTrajectory.of_rig(TRAJECTORY, segments, None).warnings == ()
        (warning,) = ScaledTrajectory.of_rig(TRAJECTORY, segments, 25).warnings
        assert warning.startswith(f"the scale of {count} segments is extrapolated")
