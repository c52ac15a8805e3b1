"""Plots of cameras in space."""

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration
from omnisight.plots._figure import new_figure
from omnisight.plots._sources import File, camera_or_rig
from omnisight.ray_camera import RayCamera
from omnisight.rig import Rig
from omnisight.sfm.reconstruction import Reconstruction

Array = NDArray[np.float64]
Scene = Camera | RayCamera | Rig | Calibration | RigCalibration | Reconstruction

# Length of the axes of a camera as a fraction of the extent of the scene.
AXIS_FRACTION = 0.12
# Least side of the box relative to its longest one: cameras in a plane still get a box.
MIN_SIDE_FRACTION = 0.3
# Share of the points of a reconstruction at each end of each axis that may lie outside the box: outliers.
OUTSIDE_SHARE = 0.01
AXIS_COLORS = ("C3", "C2", "C0")
MAX_POINTS, MAX_LABELS = 5000, 20


def plot_cameras(scene: Scene | File) -> Any:
    """Plot cameras in 3-D: x right (red), y down (green), z forward (blue) of each.

    The boards of all images of a calibration and the points of a reconstruction are drawn too.

    Parameters
    ----------
    scene
        A camera, a rig, a calibration of either, a reconstruction, or the calibration file of a camera or a rig.

    Returns
    -------
    A figure of matplotlib.
    """
    if isinstance(scene, str | PathLike):
        scene = camera_or_rig(scene)
    if isinstance(scene, RigCalibration):
        scene = scene.rig
    poses, points = _poses(scene), _points(scene)
    centres = np.array([pose.translation for pose in poses.values()])
    trimmed = [np.quantile(group, (OUTSIDE_SHARE, 1 - OUTSIDE_SHARE), axis=0) for group in points]
    length = AXIS_FRACTION * (float(np.ptp(np.concatenate([centres, *trimmed]), axis=0).max()) or 1.0)
    ends = [centres + length * np.stack([pose.rotation[:, k] for pose in poses.values()]) for k in range(3)]
    figure = new_figure(width=6.0, height=6.0)
    axes = figure.add_subplot(projection="3d")
    for group in points:
        axes.plot(*_upright(group), "." if isinstance(scene, Reconstruction) else "-", markersize=1, linewidth=0.8)
    for i, name in enumerate(poses):
        for k, color in enumerate(AXIS_COLORS):
            axes.plot(*_upright(np.stack([centres[i], ends[k][i]])), color=color)
        if len(poses) <= MAX_LABELS:
            axes.text(*_upright(centres[i]), name)
    _frame(axes, _upright(np.concatenate([centres, *ends, *trimmed])), _unit(scene))
    return figure


def _frame(axes: Any, shown: Array, unit: str) -> None:
    """Fit the box to what is shown (3, N), at one scale for all axes, and label it."""
    low, high = shown.min(1), shown.max(1)
    sides = np.maximum(high - low, MIN_SIDE_FRACTION * (high - low).max())
    middle = (low + high) / 2
    limits = zip("xyz", middle - sides / 2, middle + sides / 2, strict=True)
    axes.set(**{f"{axis}lim": (a, b) for axis, a, b in limits})
    axes.set_box_aspect(sides)
    axes.set(xlabel=f"x, {unit}", ylabel=f"z, {unit}", zlabel=f"−y, {unit}")


def _unit(scene: Any) -> str:
    """Return the unit of the positions of a scene."""
    if isinstance(scene, Reconstruction):
        return "m" if scene.has_scale else "units"
    return scene.observations.unit if isinstance(scene, Calibration) else getattr(scene, "unit", "m")


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
