"""Report of `omnisight epipolar`."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from omnisight.cli._output import write_json
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import quaternions
from omnisight.pipeline.two_views.epipolar import EpipolarResult


def print_json(result: EpipolarResult) -> None:
    """Print the result as one JSON object."""
    pose = result.b_from_a
    data = {
        "matches": len(result.matches),
        "inliers": int(result.pose.inliers.sum()) if pose else 0,
        "motion": result.motion.name,
        "b_from_a": pose and _pose(pose),
        "alternative": pose and result.pose.alternative and _pose(result.pose.alternative),
        "probability": result.pose.probability if pose else None,
        "sigma_deg": pose
        and {
            "rotation": result.sigma_rotation_deg,
            "direction": result.sigma_direction_deg if result.has_translation else None,
        },
        "parallax_deg": result.parallax_deg if pose else None,
        "median_residual_deg": result.median_residual_deg if pose else None,
        "seconds": round(result.seconds, 3),
        "reason": result.reason,
    }
    write_json(data)


def _pose(pose: Pose) -> dict[str, list[float] | None]:
    """Return the rotation and the direction of the translation."""
    return {
        "rotation_xyzw": quaternions(pose.rotation).tolist(),
        "direction": pose.translation.tolist() if pose.translation.any() else None,
    }


def print_report(result: EpipolarResult, written: Path | None) -> None:
    """Print the matches, the motion with its standard deviations, the residual and the file written."""
    pose = result.b_from_a
    if pose is None:
        return
    angle = np.degrees(Rotation.from_matrix(pose.rotation).magnitude())
    found = " and ".join(str(len(keypoints)) for keypoints in result.keypoints)
    inliers = int(result.pose.inliers.sum())
    print(f"matches    {len(result.matches)} of {found} keypoints, {inliers} inliers")
    print(f"motion     {result.motion.name}: {result.motion.figure}")
    print(f"parallax   {result.parallax_deg:.2f}° (median)")
    print(f"rotation   {angle:.3f}° ± {result.sigma_rotation_deg:.3f}°")
    if result.has_translation:
        direction = ", ".join(f"{value:.4f}" for value in pose.translation)
        print(f"direction  {direction} ± {result.sigma_direction_deg:.3f}°")
    print(f"residual   {result.median_residual_deg:.3f}° (median)")
    print(f"written    {written if written is not None else 'nothing'}")
