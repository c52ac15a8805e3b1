"""The vehicle in a bird's-eye view: it is left black, and it hides the ground on its other side from its cameras."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.images import read_mask
from omnisight.rig import Rig
from omnisight.targets.length import parse_length
from omnisight.views.ground_view import GroundView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# left, right, back, front; metres.
Rectangle = tuple[float, float, float, float]

# Cameras on the edge of the rectangle are outside of it, whatever the rounding; metres.
EDGE_M = 1e-6


def vehicle_occlusion(rig: Rig, view: GroundView, vehicle: str) -> list[Mask] | None:
    """Return for each camera the pixels (H, W) of the view that the vehicle hides from it; None without a vehicle.

    A camera at the edge of the vehicle's rectangle does not see the ground under it, nor through it. A camera inside
    looks over the vehicle.

    Parameters
    ----------
    rig
        The rig in the ground frame.
    view
        The view.
    vehicle
        See `BirdseyeOptions.vehicle`.

    Raises
    ------
    ValueError
        If `vehicle` cannot be interpreted, or is an image of another size.
    """
    if vehicle == "none":
        return None
    rectangle = camera_rectangle(rig)
    size = re.fullmatch(r"\s*([\d.]+\s*[a-z]+)\s*x\s*([\d.]+\s*[a-z]+)\s*", vehicle.lower())
    if size is not None:
        rectangle = _centred(rectangle, parse_length(size[1], "--vehicle"), parse_length(size[2], "--vehicle"))
    elif vehicle != "auto":
        if not Path(vehicle).is_file():
            raise ValueError(
                f"--vehicle {vehicle}: must be LENGTHxWIDTH with units (4.5mx1.8m), an image, auto or none"
            )
        return [~read_mask(vehicle, view.size)] * len(rig)
    width, height = view.size
    ground = view.ground(np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1))
    below = _is_crossed(rectangle, ground, ground)
    centers = [pose.inverse().translation[[0, 2]] for pose in rig.sensor_from_rig]
    return [below if _is_inside(rectangle, c) else _is_crossed(rectangle, c, ground) for c in centers]


def camera_rectangle(rig: Rig) -> Rectangle:
    """Return the rectangle that the cameras of a rig in the ground frame span."""
    centers = np.array([pose.inverse().translation for pose in rig.sensor_from_rig])
    (left, back), (right, front) = centers[:, [0, 2]].min(axis=0), centers[:, [0, 2]].max(axis=0)
    return float(left), float(right), float(back), float(front)


def _centred(rectangle: Rectangle, length: float, width: float) -> Rectangle:
    left, right, back, front = rectangle
    x, z = (left + right) / 2, (back + front) / 2
    return x - width / 2, x + width / 2, z - length / 2, z + length / 2


def _is_inside(rectangle: Rectangle, position: Array) -> bool:
    return bool(_is_crossed(rectangle, position, position[None])[0])


def _is_crossed(rectangle: Rectangle, start: Array, ends: Array) -> Mask:
    """Return which segments from a start to ends (..., 2) cross the inside of the rectangle (slab method).

    The rectangle of a single camera, or of cameras in a row, has no inside.
    """
    if min(rectangle[1] - rectangle[0], rectangle[3] - rectangle[2]) <= 2 * EDGE_M:
        return np.zeros(ends.shape[:-1], np.bool_)
    enter, leave = np.zeros(ends.shape[:-1]), np.ones(ends.shape[:-1])
    for axis, (low, high) in enumerate((rectangle[:2], rectangle[2:])):
        origin, step = start[..., axis], ends[..., axis] - start[..., axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low + EDGE_M - origin) / step, (high - EDGE_M - origin) / step
        parallel = step == 0
        within = (origin > low + EDGE_M) & (origin < high - EDGE_M)
        enter = np.maximum(enter, np.where(parallel, np.where(within, 0.0, np.inf), np.minimum(a, b)))
        leave = np.minimum(leave, np.where(parallel, np.where(within, 1.0, -np.inf), np.maximum(a, b)))
    return enter <= leave
