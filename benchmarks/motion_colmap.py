"""Odometry beside the incremental mapper of pycolmap on the same images, each matched with the following ten.

`python -m benchmarks motion --colmap` prints the errors of the trajectories and the times from files to poses. pycolmap
refines all poses together at the end; odometry is without loops. pycolmap runs on 360 images, or on the cube faces of
other cameras as a rig, in a process of its own.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import omnisight as om
from benchmarks.motion_score import errors
from benchmarks.own_process import run_module
from omnisight.geometry.pose import Pose

HEADER = (
    "| sequence | method | images with a pose | error | drift | drift °/m | seconds |\n|---|---|---|---|---|---|---|"
)


def print_comparison(label: str, folder: Path, true: Sequence[Pose]) -> None:
    """Print the rows of both methods on a rendered sequence."""
    start = time.perf_counter()
    rig = folder / "rig.json"
    options = om.OdometryOptions(loops=False)
    is_rig = rig.exists()
    result = (
        om.odometry(folder, rig=rig, options=options)
        if is_rig
        else om.odometry(folder / "images", folder / "camera.json", options=options)
    )
    seconds = time.perf_counter() - start
    print(row(label, "omnisight", {p.frame: p.rig_from_world for p in result.trajectory}, true, seconds), flush=True)
    is_sphere = not is_rig and om.load(folder / "camera.json").model.name == "equirectangular"
    method = f"pycolmap {'360' if is_sphere else 'cube rig'}, incremental"
    start = time.perf_counter()
    try:
        rows = run_module("benchmarks.sfm_methods", [method, str(folder)])
    except RuntimeError as error:
        print(f"| {label} | {method} | failed: {str(error).splitlines()[-1]} | | | | |", flush=True)
        return
    poses = {int(r[1]): Pose.of_matrix(np.array(r[2:], float).reshape(3, 4)) for r in rows if r[0] == "pose"}
    print(row(label, method, poses, true, time.perf_counter() - start), flush=True)


def row(label: str, method: str, rig_from_world: dict[int, Pose], true: Sequence[Pose], seconds: float) -> str:
    """Return the row of the poses of a method, by frame."""
    frames = sorted(rig_from_world)
    coverage = f"{len(frames)} of {len(true)}"
    if len(frames) < 3:
        return f"| {label} | {method} | {coverage} | failed | | | {seconds:.0f} |"
    score = errors([rig_from_world[frame].inverse() for frame in frames], [true[frame] for frame in frames])
    figures = f"{score.position:.3%} | {score.drift:.3%} | {score.drift_deg_per_m:.4f}"
    return f"| {label} | {method} | {coverage} | {figures} | {seconds:.0f} |"
