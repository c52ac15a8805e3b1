"""What lines do not tell: tan(theta) -> k tan(theta) keeps every great circle a great circle."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel

Array = NDArray[np.float64]

# What is not the shape of r(theta): a model with more than one number beside them bends freely.
NO_SHAPE = {"fx", "fy", "cx", "cy", "skew", "c", "d", "e"}

# The least doubt about the scale, as a share of it, for real cameras are quite of neither family: ten of eleven
# calibrations are 0 to 1.2 % off the unified one (`python -m benchmarks.lines shapes`).
LEAST = 0.02
# The share of the scale that is asked about, at most, and how many angles are looked at.
MOST = 0.5
ANGLES = 60
FEWEST = 8


def scale_deviation(model: CameraModel, pixels: Array) -> float:
    """Give what the doubt about the scale makes of the bearings of pixels (N, 2), radians, rms.

    It moves a bearing by sin(theta) cos(theta) times its share.
    """
    bearings, valid = model.unproject_numpy(pixels)
    b = bearings[valid]
    share = float(np.hypot(shape_doubt(model, b), LEAST))
    return share * float(np.sqrt((b[:, 2] ** 2 * (1 - b[:, 2] ** 2)).mean())) if len(b) else np.inf


def shape_doubt(model: CameraModel, bearings: Array) -> float:
    """Give by which share of the scale two families of shapes disagree that see the same lines straight.

    The scale is told by the shape of r(theta) alone, so by what is taken for a shape. The unified model is one family,
    r = sin(theta)/(xi + cos(theta)); another is r = tan(a theta)/a, with a^2 < 0 too, where it is tanh. Both hold the
    pinhole and the parabolic mirror; equidistant lenses are of the second alone, hyperbolic mirrors of the first alone,
    and most lenses lie between them. Each is asked which k makes r(arctan(k tan(theta))) the radius that the model has
    where the bearings (N, 3) are.
    """
    theta = np.quantile(angle_from_axis(bearings), np.linspace(0, 1, ANGLES)) if len(bearings) else np.zeros(0)
    ray = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1)
    pixels, valid = model.project_numpy(np.concatenate([ray, -ray * (1, 1, -1)]))
    there, back = pixels[:ANGLES], pixels[ANGLES:]
    # Half of what lies between two opposite directions: the axis itself may be out of sight.
    radius = np.linalg.norm(there - back, axis=1) / 2
    seen = valid.reshape(2, -1).all(0) & (radius > 0)
    if seen.sum() < FEWEST:
        return MOST
    theta, radius = theta[seen], radius[seen] / radius[seen].max()
    told = [_scale_told(family, theta, radius) for family in (_unified, _tangent)]
    return float(min(max(map(abs, told)), MOST))


def _unified(theta: Array, shape: float) -> Array:
    """Give r for 1/xi = exp(shape)."""
    xi = np.exp(-shape)
    return (1 + xi) * np.sin(theta) / np.maximum(xi + np.cos(theta), 1e-3)


def _tangent(theta: Array, shape: float) -> Array:
    """Give r for a^2 = shape."""
    a = np.sqrt(abs(shape)) + 1e-9
    return np.tan(np.minimum(a * theta, 1.55)) / a if shape > 0 else np.tanh(a * theta) / a


def _scale_told(family: Callable[[Array, float], Array], theta: Array, radius: Array) -> float:
    """Give the logarithm of the k that a family of shapes finds."""
    from scipy.optimize import least_squares

    def off(p: Array) -> Array:
        scaled = np.arctan2(np.exp(p[1]) * np.sin(theta), np.cos(theta))
        return np.exp(p[0]) * family(scaled, float(p[2])) - radius

    start = float(np.log(radius.max() / family(theta, 0.0).max()))
    return float(least_squares(off, [start, 0.0, 0.0], x_scale=[1.0, 0.1, 0.3]).x[1])


def bends_freely(model: CameraModel) -> bool:
    """Say whether a model has so many numbers for its shape that it follows a change of scale."""
    return len(set(model.param_names) - NO_SHAPE) > 1


def without_scale(freedom: Freedom, model: CameraModel, pixels: Array) -> Freedom:
    """Give the freedom without the combination of parameters that scales tan(theta) where the pixels (N, 2) are.

    A bearing b moves with k as t = b_z (e_z - b_z b), and with the parameters by D. Scaling is what has a share along
    t, so steps x with sum t^T D x = 0 are left. No one parameter would do in its place: where no line comes near the
    axis, a focal length there is held by nothing, and holds nothing.
    """
    bearings, valid, _, d_params = model.unproject_with_jacobians(pixels)
    valid &= np.isfinite(d_params).all((1, 2))
    b = bearings[valid]
    slopes = d_params[valid] @ freedom.directions
    scaling = b[:, 2:] * (np.array([0.0, 0.0, 1.0]) - b[:, 2:] * b)
    # Parameters of very different size (px, px^-3): each by what it does to the bearings.
    unit = 1 / np.maximum(np.sqrt((slopes**2).sum((0, 1))), 1e-300)
    share = np.einsum("ni,niq->q", scaling, slopes) * unit
    kept = np.linalg.svd(share[None])[2][1:].T
    return dataclasses.replace(freedom, directions=freedom.directions @ (unit[:, None] * kept))
