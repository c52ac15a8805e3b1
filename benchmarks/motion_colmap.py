"""Odometry beside the incremental mapper of pycolmap on the same images, each matched with the following ten.

`python -m benchmarks motion --colmap` prints the errors of the trajectories and the times from files to poses. pycolmap
refines all poses together at the end; odometry is without loops. pycolmap runs on 360 images, or on the cube faces of
other cameras as a rig, in a process of its own.
"""

import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.motion_score import errors
from benchmarks.own_process import run_module
from benchmarks.sfm_methods import printed_poses
from omnisight.geometry.pose import Pose

HEADER = (
    "| sequence | method | images with a pose | error | drift | drift °/m | seconds |\n|---|---|---|---|---|---|---|"
)


def colmap_row(label: str, folder: Path, camera: str, true: Sequence[Pose]) -> str:
    """Return the row of pycolmap on a rendered sequence of a kind of camera."""
    method = f"pycolmap {'360' if camera == 'sphere' else 'cube rig'}, incremental"
    start = time.perf_counter()
    try:
        rows = run_module("benchmarks.sfm_methods", [method, str(folder)])
    except RuntimeError as error:
        return f"| {label} | {method} | failed: {str(error).splitlines()[-1]} | | | | |"
    poses = {frame: Pose.of_matrix(matrix) for frame, matrix in printed_poses(rows).items()}
    return row(label, method, poses, true, time.perf_counter() - start)


def row(label: str, method: str, rig_from_world: dict[int, Pose], true: Sequence[Pose], seconds: float) -> str:
    """Return the row of the poses of a method, by frame."""
    frames = sorted(rig_from_world)
    coverage = f"{len(frames)} of {len(true)}"
    if len(frames) < 3:
        return f"| {label} | {method} | {coverage} | failed | | | {seconds:.0f} |"
    score = errors([rig_from_world[frame].inverse() for frame in frames], [true[frame] for frame in frames])
    figures = f"{score.position:.3%} | {score.drift:.3%} | {score.drift_deg_per_m:.4f}"
    return f"| {label} | {method} | {coverage} | {figures} | {seconds:.0f} |"
