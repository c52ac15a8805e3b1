"""The trajectory of all frames, given corrected keyframes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.pose_graph import Similarities
from omnisight.visual_odometry.frame_result import TrackedPose

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def correct_trajectory(
    trajectory: Sequence[TrackedPose], frames: Indices, nodes: Similarities
) -> tuple[TrackedPose, ...]:
    """Return a trajectory in which keyframes have new poses, and other frames follow.

    A frame keeps its pose relative to the keyframes before and after it. Between these two it is interpolated.

    Parameters
    ----------
    trajectory
        Poses of all frames.
    frames
        (K,) frames of keyframes, increasing; some may have no pose.
    nodes
        (K) world_from_keyframe of the corrected world, with their scales.
    """
    old = _similarities(trajectory)
    index = np.array([pose.frame for pose in trajectory])
    is_known = np.isin(frames, index)
    frames, nodes = frames[is_known], nodes[is_known]
    of_keyframe = np.searchsorted(index, frames)
    before = np.clip(np.searchsorted(frames, index, side="right") - 1, 0, len(frames) - 1)
    after = np.clip(np.searchsorted(frames, index), 0, len(frames) - 1)
    ends = [nodes[k] @ (old[of_keyframe[k]].inverse() @ old) for k in (before, after)]
    share = (index - frames[before]) / np.maximum(frames[after] - frames[before], 1)
    share = np.clip(share, 0.0, 1.0)[:, None]
    turn = so3.log(np.swapaxes(ends[0].rotation, 1, 2) @ ends[1].rotation)
    rotation = ends[0].rotation @ so3.exp(share * turn)
    position = ends[0].position + share * (ends[1].position - ends[0].position)
    return tuple(
        replace(pose, rig_from_world=Pose(turned, moved).inverse())
        for pose, turned, moved in zip(trajectory, rotation, position, strict=True)
    )


def _similarities(trajectory: Sequence[TrackedPose]) -> Similarities:
    """Return world_from_rig of all poses, of scale 1."""
    inverse = [pose.rig_from_world.inverse() for pose in trajectory]
    rotation, position = (np.array([getattr(pose, name) for pose in inverse]) for name in ("rotation", "translation"))
    return Similarities(rotation, position, np.zeros(len(inverse)))
