"""Where each pixel of a view is seen in the source, and how densely."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models._protocol import run

if TYPE_CHECKING:
    from omnisight.views.remapper import Remapper

Floats = NDArray[np.float32]
Array = NDArray[np.float64]


def view_map(source: Camera, target: Camera, target_from_source: Array) -> tuple[Floats, Floats]:
    """Give the source pixel (u, v) of every pixel of the target, each (H, W) float32; NaN where the source sees nothing.

    Parameters
    ----------
    source, target
        The camera that took the picture, and the view.
    target_from_source
        (3, 3) orthogonal; a reflection flips the view.
    """
    shape = (target.height, target.width)
    u, v = np.empty(shape, np.float32), np.empty(shape, np.float32)
    source_from_target = np.ascontiguousarray(np.asarray(target_from_source, float).T)
    run("map_view", target.model.kernel, source.model.kernel, source_from_target, u, v, count=target.height, grain=16)
    return u, v


def map_scale(u: Floats, v: Floats, period: float | None, step: int = 1) -> Floats:
    """Give how many source pixels one pixel of the view spans along its denser direction, on every `step`-th pixel; NaN unknown."""
    across = _stride(u, v, period, step, axis=1)
    down = _stride(u, v, period, step, axis=0)
    with np.errstate(invalid="ignore"):
        return np.fmax(across, down).astype(np.float32)


def _stride(u: Floats, v: Floats, period: float | None, step: int, axis: int) -> Floats:
    near = [slice(None, None, step), slice(None, None, step)]
    length = u.shape[axis]
    here = np.arange(0, length, step)
    other = np.where(here + 1 < length, here + 1, here - 1)
    other = np.clip(other, 0, length - 1)
    du = np.take(u, other, axis)[tuple(near[:axis] + [slice(None)] + near[axis + 1 :])] - u[tuple(near)]
    dv = np.take(v, other, axis)[tuple(near[:axis] + [slice(None)] + near[axis + 1 :])] - v[tuple(near)]
    if period:
        du -= np.float32(period) * np.round(du / np.float32(period))
    return np.hypot(du, dv)


def kept_share(source: Camera, target: Camera, target_from_source: Array, count: int = 200) -> float:
    """Give the share of the source's pixels that the view shows, of those that its camera can unproject."""
    u, v = np.meshgrid(np.linspace(0, source.width - 1, count), np.linspace(0, source.height - 1, count))
    bearings, valid = source.unproject(np.stack([u, v], -1))
    pixels, shown = target.project(bearings[valid] @ np.asarray(target_from_source).T)
    if not valid.any():
        return 0.0
    return float((shown & target.in_image(pixels)).mean())


def magnification(remapper: "Remapper") -> tuple[float, float]:
    """Give how many pixels of the view a pixel of the source fills, at the view's middle and at the rim of what is shown."""
    u, v = view_map(remapper.source, remapper.target, remapper.target_from_source)
    step = max(1, min(u.shape) // 200)
    scale = map_scale(u, v, remapper.source.model.period, step)
    scale[~remapper.mask[::step, ::step]] = np.nan
    rows, columns = np.nonzero(np.isfinite(scale) & (scale > 0))
    if not rows.size:
        return float("nan"), float("nan")
    away = np.hypot(rows - (scale.shape[0] - 1) / 2, columns - (scale.shape[1] - 1) / 2)
    order = np.argsort(away)
    few = max(1, len(order) // 100)
    values = 1 / scale[rows, columns]
    return float(np.median(values[order[:few]])), float(np.median(values[order[-few:]]))
