"""Remap tables from a view to its source image, their scale and coverage."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models._run_compiled import run_compiled

Floats = NDArray[np.float32]
Array = NDArray[np.float64]

# Rows whose bearings are computed at once: those of all pixels need ten times the memory of the image.
STRIP_ROWS = 32
# Samples along the shorter side, from which measures of a view or of an image are computed.
SAMPLES = 200
# The same for each frame of a moving view, in 2 % of the processor time of its map (720p).
FRAME_SAMPLES = 32


def view_map(source: Camera, target: Camera, target_from_source: Array) -> tuple[Floats, Floats]:
    """Return the source pixel (u, v) of every target pixel, each (H, W) float32; NaN where there is none.

    Parameters
    ----------
    source, target
        The camera of the image and the camera of the view.
    target_from_source
        (3, 3) orthogonal; a reflection mirrors the view.
    """
    shape = (target.height, target.width)
    u, v = np.empty(shape, np.float32), np.empty(shape, np.float32)
    source_from_target = np.ascontiguousarray(np.asarray(target_from_source, float).T)
    models = target.model.name, source.model.name
    kernels = target.model.kernel, source.model.kernel
    run_compiled("map_view", models, *kernels, source_from_target, u, v, count=target.height, grain=16)
    return u, v


def is_periodic(source: Camera) -> bool:
    """Return whether the left and the right edge of the images of a camera adjoin (360 degrees)."""
    period = source.model.period
    return period is not None and abs(period - source.width) < 0.5


def coverage_mask(source: Camera, u: Floats, v: Floats) -> NDArray[np.bool_]:
    """Return which source pixels (u, v) of a `view_map`, each (H, W), are in the image of the source."""
    with np.errstate(invalid="ignore"):
        mask = (u >= -0.5) & (u < source.width - 0.5) & (v >= -0.5) & (v < source.height - 0.5)
        if is_periodic(source):  # coordinates that round across the seam are valid
            mask |= (u >= -1.0) & (u <= source.width) & (v >= -0.5) & (v < source.height - 0.5)
    return mask


def extrapolation_mask(source: Camera, target: Camera, target_from_source: Array) -> NDArray[np.bool_]:
    """Return which target pixels (H, W) are outside the calibrated field of view of the source; see `view_map`."""
    mask = np.zeros((target.height, target.width), np.bool_)
    if source.theta_max is None:
        return mask
    for top in range(0, target.height, STRIP_ROWS):
        pixels = np.stack(np.meshgrid(np.arange(target.width), np.arange(target.height)[top : top + STRIP_ROWS]), -1)
        bearings, valid = target.unproject(pixels)
        mask[top : top + STRIP_ROWS] = valid & ~source.calibrated(bearings @ np.asarray(target_from_source, float))
    return mask


def extrapolated_fraction(source: Camera, target: Camera, rotations: Sequence[Array]) -> float:
    """Return the share of covered pixels outside the calibrated field of view, in views target_from_source (3, 3)."""
    covered, outside = _covered_and_outside(source, reduced_view(target), rotations)
    return float((covered & outside).sum() / max(covered.sum(), 1))


def calibrated_fraction(source: Camera, target: Camera, rotations: Sequence[Array]) -> float:
    """Return the share of pixels covered within the calibrated field of view, in views target_from_source (3, 3).

    It has few samples, for every frame of a clip.
    """
    covered, outside = _covered_and_outside(source, reduced_view(target, FRAME_SAMPLES), rotations)
    return float((covered & ~outside).mean())


def _covered_and_outside(
    source: Camera, target: Camera, rotations: Sequence[Array]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which pixels of views (V, H, W) are covered, and which are outside the calibrated field of view."""
    covered = [coverage_mask(source, *view_map(source, target, rotation)) for rotation in rotations]
    outside = [extrapolation_mask(source, target, rotation) for rotation in rotations]
    return np.array(covered), np.array(outside)


def reduced_view(target: Camera, samples: int = SAMPLES) -> Camera:
    """Return a view reduced to the pixels that measures of the view need."""
    return target.scaled(min(1.0, samples / min(target.size)))


def resolution(camera: Camera, bearings: Array) -> Array:
    """Return the pixels per radian (N,) at bearings (N, 3), in the direction with the fewest."""
    _, _, d_point, _ = camera.model.project_with_jacobians(bearings)
    return np.asarray(np.linalg.svd(d_point, compute_uv=False)[:, -1], float)


def map_scale(source: Camera, u: Floats, v: Floats, step: int = 1) -> Floats:
    """Return how many source pixels a view pixel spans in its denser direction, at every `step`-th pixel; or NaN.

    In a periodic source (360 degrees) columns are weighted by the cosine of the latitude, because near a pole many of
    them have nearly the same direction.
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
    """Return the distance in the source between neighbouring view pixels along an axis."""
    here = np.arange(0, u.shape[axis], step)
    other = np.clip(np.where(here + 1 < u.shape[axis], here + 1, here - 1), 0, None)
    lines = np.s_[:, ::step] if axis == 0 else np.s_[::step]
    du, dv = (np.take(m[lines], other, axis) - m[::step, ::step] for m in (u, v))
    if period and level is not None:
        du -= np.float32(period) * np.round(du / np.float32(period))
        du *= level
    return np.hypot(du, dv)


def visible_fraction(source: Camera, target: Camera, target_from_source: Array) -> float:
    """Return the fraction of the source's valid pixels that the view shows."""
    u, v = np.meshgrid(np.linspace(0, source.width - 1, SAMPLES), np.linspace(0, source.height - 1, SAMPLES))
    bearings, valid = source.unproject(np.stack([u, v], -1))
    pixels, shown = target.project(bearings[valid] @ np.asarray(target_from_source).T)
    if not valid.any():
        return 0.0
    return float((shown & target.in_image(pixels)).mean())
