"""Closing of loops: a trajectory without the drift between visits of the same place."""

from collections.abc import Sequence

import numpy as np

from omnisight.optim.pose_graph import optimize_pose_graph
from omnisight.visual_odometry.frame_result import TrackedPose
from omnisight.visual_odometry.keyframe_history import KeyframeHistory
from omnisight.visual_odometry.loop_bundle import adjust_globally
from omnisight.visual_odometry.loop_detection import LoopDetector
from omnisight.visual_odometry.loop_graph import loop_edges, odometry_edges, world_from_keyframes
from omnisight.visual_odometry.loop_result import LoopClosure
from omnisight.visual_odometry.trajectory_correction import correct_trajectory

NO_LOOP = "no place was seen again"
ALL_WRONG = "places look alike, but their poses contradict the trajectory"


def close_loops(history: KeyframeHistory, trajectory: Sequence[TrackedPose], *, has_scale: bool) -> LoopClosure:
    """Detect places that were seen before, and refine all keyframes together, given these loops.

    Global bundle adjustment decreases the errors without loops, too: see the table in docs/guide/odometry.md.

    Parameters
    ----------
    history
        The keyframes.
    trajectory
        Poses of all frames in the world of odometry.
    has_scale
        Whether the scale is known: poses are rigid then; otherwise the scale drifts too.
    """
    if not len(history):
        return LoopClosure(tuple(trajectory), reason=NO_LOOP)
    detector = LoopDetector(history, has_scale=has_scale)
    edges = odometry_edges(history).joined(loop_edges(detector.loops, detector.places))
    graph = optimize_pose_graph(edges, world_from_keyframes(history), has_scale=has_scale)
    is_correct = graph.is_correct[len(history) - 1 :]
    loops = [loop for loop, correct in zip(detector.loops, is_correct, strict=True) if correct]
    rejected = tuple(loop.loop for loop, correct in zip(detector.loops, is_correct, strict=True) if not correct)
    rows, nodes = adjust_globally(history, detector, loops, graph.nodes)
    corrected = correct_trajectory(trajectory, np.array(history.frames)[rows], nodes)
    moved = [
        np.linalg.norm(new.rig_from_world.inverse().translation - old.rig_from_world.inverse().translation)
        for old, new in zip(trajectory, corrected, strict=True)
    ]
    reason = "" if loops else ALL_WRONG if rejected else NO_LOOP
    return LoopClosure(corrected, tuple(loop.loop for loop in loops), rejected, float(max(moved)), reason)
