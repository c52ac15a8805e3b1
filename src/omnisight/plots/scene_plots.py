"""Plots of cameras in space."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.pipeline.calibration import Calibration
from omnisight.plots._figure import new_figure
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.sfm.reconstruction import Reconstruction

Array = NDArray[np.float64]

# Length of the axes of a camera as a fraction of the extent of the scene.
AXIS_FRACTION = 0.12
AXIS_COLORS = ("C3", "C2", "C0")
MAX_POINTS, MAX_LABELS = 5000, 20


def plot_cameras(scene: Camera | RayCamera | Rig | Calibration | Reconstruction) -> Any:
    """Plot cameras in 3-D: x right (red), y down (green), z forward (blue) of each.

    The boards of all images of a calibration and the points of a reconstruction are drawn too.

    Parameters
    ----------
    scene
        A camera, a rig, a calibration or a reconstruction.

    Returns
    -------
    A figure of matplotlib.
    """
    poses = _poses(scene)
    points = _points(scene)
    centres = np.array([pose.translation for pose in poses.values()])
    everything = np.concatenate([centres, *points])
    middle = np.median(everything, axis=0)
    extent = float(np.quantile(np.linalg.norm(everything - middle, axis=1), 0.98)) or 1.0
    figure = new_figure(width=6.0, height=6.0)
    axes = figure.add_subplot(projection="3d")
    for group in points:
        axes.plot(*_upright(group), "." if len(points) == 1 else "-", markersize=1, linewidth=0.8)
    for name, pose in poses.items():
        for k, color in enumerate(AXIS_COLORS):
            ends = np.stack([pose.translation, pose.translation + AXIS_FRACTION * extent * pose.rotation[:, k]])
            axes.plot(*_upright(ends), color=color)
        if len(poses) <= MAX_LABELS:
            axes.text(*_upright(pose.translation), name)
    centre = _upright(middle)
    axes.set(**{f"{axis}lim": (c - extent, c + extent) for axis, c in zip("xyz", centre, strict=True)})
    axes.set_box_aspect((1, 1, 1))
    axes.set(xlabel="x", ylabel="z", zlabel="−y")
    return figure


def _poses(scene: Any) -> dict[str, Pose]:
    """Return the poses world_from_cam of the cameras of a scene by name."""
    if isinstance(scene, Rig):
        return {name: pose.inverse() for name, pose in zip(scene.names, scene.sensor_from_rig, strict=True)}
    if isinstance(scene, Reconstruction):
        return {name: scene.world_from_cam(i) for i, name in enumerate(scene.names)}
    return {"camera": Pose()}


def _points(scene: Any) -> list[Array]:
    """Return the points of a scene: one outline (N, 3) per board, or one set of points."""
    if isinstance(scene, Reconstruction):
        position = scene.points.position
        return [position[:: max(1, len(position) // MAX_POINTS)]] if len(position) else []
    if not isinstance(scene, Calibration):
        return []
    (x0, y0), (x1, y1) = scene.observations.extent
    outline = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0], [x0, y0, 0]], float)
    state = scene.state
    return [outline @ turn.T + shift for turn, shift in zip(state.rotations, state.translations, strict=True)]


def _upright(points: Array) -> Array:
    """Return points (..., 3) as coordinates (3, ...) of a plot whose vertical axis is up."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]])
