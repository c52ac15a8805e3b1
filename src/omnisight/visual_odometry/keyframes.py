"""When a frame becomes a keyframe."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.ray_observations import FrameRays, common
from omnisight.visual_odometry.window import KeyframeWindow

# Median change (radians) of the directions of points since the last keyframe, without that by the rotation.
MIN_PARALLAX_RAD = np.radians(2.0)
# Share of the patches of the last keyframe that are still seen.
MIN_SHARE = 0.7


def is_keyframe(window: KeyframeWindow, rays: FrameRays, rig_from_world: Pose) -> bool:
    """Return whether a frame adds parallax to a window, or shows too few patches of its last keyframe."""
    last = window.last_rays
    a, b = common(last, rays)
    if len(b) < MIN_SHARE * len(last):
        return True
    turn = rig_from_world.rotation @ window.keyframes[-1].rig_from_world.rotation.T
    chord = np.linalg.norm(a.bearings @ turn.T - b.bearings, axis=1)
    return float(np.median(chord)) > MIN_PARALLAX_RAD
