"""Where each pixel of a view is seen in the source, and how densely."""

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models._threads import run

Floats = NDArray[np.float32]
Array = NDArray[np.float64]


def view_map(source: Camera, target: Camera, target_from_source: Array) -> tuple[Floats, Floats]:
    """Give the source pixel (u, v) of every pixel of the target, each (H, W) float32; NaN where there is none.

    Parameters
    ----------
    source, target
        The camera that took the image, and the view.
    target_from_source
        (3, 3) orthogonal; a reflection flips the view.
    """
    shape = (target.height, target.width)
    u, v = np.empty(shape, np.float32), np.empty(shape, np.float32)
    source_from_target = np.ascontiguousarray(np.asarray(target_from_source, float).T)
    models = target.model.name, source.model.name
    kernels = target.model.kernel, source.model.kernel
    run("map_view", models, *kernels, source_from_target, u, v, count=target.height, grain=16)
    return u, v


def extrapolation_mask(source: Camera, target: Camera, target_from_source: Array) -> NDArray[np.bool_]:
    """Say which pixels of the target (H, W) look where the source was not calibrated; see `view_map`."""
    if source.theta_max is None:
        return np.zeros((target.height, target.width), np.bool_)
    rows = np.arange(target.height)
    past = np.empty((target.height, target.width), np.bool_)
    for row in rows:  # a row at a time: bearings of all of it would be ten times the image
        pixels = np.stack([np.arange(target.width), np.full(target.width, row)], -1)
        bearings, valid = target.unproject(pixels)
        past[row] = valid & ~source.calibrated(bearings @ np.asarray(target_from_source, float))
    return past


def map_scale(source: Camera, u: Floats, v: Floats, step: int = 1) -> Floats:
    """Give how many source pixels a pixel of the view spans along its denser direction, on every `step`-th; or NaN.

    Where the source goes around, columns count by what they span in angle: near a pole many of them are one direction,
    and no denser than the rows.
    """
    period, level = source.model.period, None
    if period:
        rows = v[::step, ::step]
        bearings, _ = source.unproject(np.stack([np.full_like(rows, source.width / 2), rows], -1))
        level = np.hypot(bearings[..., 0], bearings[..., 2]).astype(np.float32)
    across = _stride(u, v, period, level, step, axis=1)
    down = _stride(u, v, period, level, step, axis=0)
    with np.errstate(invalid="ignore"):
        return np.fmax(across, down).astype(np.float32)


def _stride(u: Floats, v: Floats, period: float | None, level: Floats | None, step: int, axis: int) -> Floats:
    here = np.arange(0, u.shape[axis], step)
    other = np.clip(np.where(here + 1 < u.shape[axis], here + 1, here - 1), 0, None)
    lines = np.s_[:, ::step] if axis == 0 else np.s_[::step]
    du, dv = (np.take(m[lines], other, axis) - m[::step, ::step] for m in (u, v))
    if period and level is not None:
        du -= np.float32(period) * np.round(du / np.float32(period))
        du *= level
    return np.hypot(du, dv)


def visible_fraction(source: Camera, target: Camera, target_from_source: Array, count: int = 200) -> float:
    """Give the share of the source's pixels that the view shows, of those that its camera can unproject."""
    u, v = np.meshgrid(np.linspace(0, source.width - 1, count), np.linspace(0, source.height - 1, count))
    bearings, valid = source.unproject(np.stack([u, v], -1))
    pixels, shown = target.project(bearings[valid] @ np.asarray(target_from_source).T)
    if not valid.any():
        return 0.0
    return float((shown & target.in_image(pixels)).mean())
