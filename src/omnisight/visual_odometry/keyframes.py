"""When a frame becomes a keyframe."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.visual_odometry.ray_observations import FrameRays, common
from omnisight.visual_odometry.window import Keyframe

# Median change (radians) of the directions of points since the last keyframe, without that by the rotation.
MIN_PARALLAX_RAD = np.radians(2.0)
# Share of the patches of the last keyframe that are still seen.
MIN_SHARE = 0.7


def is_keyframe(last: Keyframe, rays: FrameRays, rig_from_world: Pose) -> bool:
    """Return whether a frame adds parallax, or shows too few patches of the last keyframe."""
    a, b = common(last.rays, rays)
    if len(b) < MIN_SHARE * len(last.rays):
        return True
    turn = rig_from_world.rotation @ last.rig_from_world.rotation.T
    chord = np.linalg.norm(a.bearings @ turn.T - b.bearings, axis=1)
    return float(np.median(chord)) > MIN_PARALLAX_RAD
