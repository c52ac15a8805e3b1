"""Uncertainty of relative poses of keyframes in the pose graph: `python -m benchmarks motion --edges`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.motion_drives import Drive
from benchmarks.motion_loops import track
from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.pose_graph import PoseGraph, RelativeEdges, Similarities
from omnisight.visual_odometry.loop_graph import odometry_edges

Array = NDArray[np.float64]

DRIVES = (Drive("room", "fisheye", 199), Drive("street", "sphere", 110), Drive("town", "fisheye", 170))
# Keyframes between which relative poses are compared, and those at the start that are left out: the first window.
STEPS, FIRST = (1, 2, 5, 10, 30), 15
# Keyframes before and after one whose path determines its scale.
SCALE_KEYFRAMES = 5


def print_edges(quick: bool) -> None:
    """Print the table: the mean squares of errors over their covariance, per degree of freedom, are 1 if it is true."""
    print("\n| drive | keyframes apart | rotation | translation | scale | all |")
    print("|---|---|---|---|---|---|")
    for drive in DRIVES[:1] if quick else DRIVES:
        history = track(drive)._history  # pyright: ignore[reportPrivateUsage]
        assert history is not None
        poses = drive.trajectory.poses
        true = [poses[frame] for frame in history.frames]
        edges, log_scale = odometry_edges(history), log_scales([pose.inverse() for pose in history.poses], true)
        for step in STEPS:
            starts = range(FIRST, len(true) - step - SCALE_KEYFRAMES, max(1, step // 5))
            ratios = np.mean([squared_ratios(edges, true, log_scale, (k, k + step)) for k in starts], axis=0)
            print(f"| {drive.route}, {drive.camera} | {step} | {' | '.join(f'{x:.2f}' for x in ratios)} |", flush=True)


def log_scales(found: Sequence[Pose], true: Sequence[Pose]) -> Array:
    """Return the logarithms of the metres per unit of odometry at keyframes, from poses world_from_rig."""
    lengths = [np.linalg.norm(np.diff([p.translation for p in poses], axis=0), axis=1) for poses in (true, found)]
    parts = [slice(max(k - SCALE_KEYFRAMES, 0), k + SCALE_KEYFRAMES) for k in range(len(true))]
    return np.log([lengths[0][part].sum() / lengths[1][part].sum() for part in parts])


def squared_ratios(edges: RelativeEdges, true: Sequence[Pose], log_scale: Array, ends: tuple[int, int]) -> list[float]:
    """Return the squared errors of rotation, translation, scale and all between two keyframes, over the stated ones."""
    a, b = ends
    found, covariance = _chained(edges, a, b)
    exact = true[a].inverse() @ true[b]
    turn = so3.log(found.rotation[0].T @ exact.rotation)
    shift = exact.translation * np.exp(-log_scale[a]) - found.position[0]
    error = np.concatenate([turn, shift, [log_scale[b] - log_scale[a]]])
    parts = slice(0, 3), slice(3, 6), slice(6, 7), slice(0, 7)
    return [
        float(error[part] @ np.linalg.solve(covariance[part, part], error[part])) / len(error[part]) for part in parts
    ]


def _chained(edges: RelativeEdges, a: int, b: int) -> tuple[Similarities, Array]:
    """Return the similarity a_from_b that consecutive edges imply, and its covariance (7, 7)."""
    rows = np.arange(a, b)
    nodes = Similarities(np.eye(3)[None], np.zeros((1, 3)), np.zeros(1))
    for row in rows:
        nodes = nodes.joined(nodes[-1:] @ edges.a_from_b[row : row + 1])
    part = RelativeEdges(rows - a, rows - a + 1, edges.a_from_b[rows], edges.root[rows], edges.may_be_wrong[rows])
    jacobian = PoseGraph(part, has_scale=False).linearize(nodes).jacobian.toarray()
    return nodes[-1:], np.linalg.inv(jacobian.T @ jacobian)[-7:, -7:]
