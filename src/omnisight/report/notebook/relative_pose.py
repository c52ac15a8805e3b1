"""HTML of a relative pose: both cameras from above."""

import numpy as np

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.report.notebook._summary import plan, summary
from omnisight.twoview.relative_pose import RelativePose


def html(result: RelativePose) -> str:
    """Return the motion with its standard deviations and a plan of both cameras, or why there is none."""
    if result.b_from_a is None:
        return summary("RelativePose", {"not found": result.reason}, None)
    pose = result.b_from_a
    sigma = np.degrees(np.sqrt(np.diagonal(result.covariance)))
    turn, shift = np.degrees(so3.log(pose.rotation)), pose.translation
    figures = {
        "motion": result.motion.name,
        "rotation": f"{np.linalg.norm(turn):.3f}° ± {np.linalg.norm(sigma[:3]):.2g}°",
        "direction": f"({', '.join(f'{x:.3f}' for x in shift)}) ± {np.linalg.norm(sigma[3:]):.2g}°",
        "inliers": f"{int(result.inliers.sum())} of {len(result.inliers)}",
        "noise": f"{result.sigma_deg:.3g}° (1σ)",
    }
    drawing = plan({"a": Pose(), "b": pose.inverse()}, "baselines") if np.any(shift) else None
    return summary("RelativePose", figures, drawing)
