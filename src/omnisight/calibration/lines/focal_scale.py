"""Observability of the focal scale: tan(theta) -> k tan(theta) maps every great circle to a great circle."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.geometry.sphere import angle_from_axis
from omnisight.models import CameraModel
from omnisight.optim.gauss_newton import gauss_newton

Array = NDArray[np.float64]

# Parameters that do not shape r(theta). A model with more than one other parameter can absorb a change of scale.
NON_SHAPE_PARAMETERS = {"fx", "fy", "cx", "cy", "skew", "c", "d", "e"}
# Relative standard deviation of the scale for real cameras, which follow neither family exactly: ten of eleven
# calibrations are 0 to 1.2 % off the unified family (`python -m benchmarks.lines shapes`).
MIN_SCALE_SIGMA = 0.02
# Relative ambiguity assigned where the scale cannot be determined.
MAX_SCALE_AMBIGUITY = 0.5
# Angles at which the families are fitted, and the fewest that determine their three parameters well.
FIT_ANGLES, MIN_FIT_ANGLES = 60, 8
# Step of the numerical derivatives of dimensionless quantities: near the cube root of the rounding error.
DIFFERENCE_STEP = 1e-6


def scale_bearing_sigma(model: CameraModel, pixels: Array) -> float:
    """Return the standard deviation (radians, rms) that the uncertainty of the scale adds to the bearings of pixels.

    A relative change s of tan(theta) moves a bearing by s sin(theta) cos(theta).
    """
    bearings, valid = model.unproject_numpy(pixels)
    b = bearings[valid]
    sigma = float(np.hypot(scale_ambiguity(model, b), MIN_SCALE_SIGMA))
    return sigma * float(np.sqrt((b[:, 2] ** 2 * (1 - b[:, 2] ** 2)).mean())) if len(b) else np.inf


def scale_ambiguity(model: CameraModel, bearings: Array) -> float:
    """Return the relative scale difference of two families of radial profiles for which the same lines are straight.

    Only the shape of r(theta) determines the scale, so the result depends on the assumed family of shapes. The unified
    family is r = sin(theta)/(xi + cos(theta)), the tangent family r = tan(a theta)/a, or tanh for a^2 < 0. Both contain
    the pinhole and the parabolic mirror; equidistant lenses are in the second only, hyperbolic mirrors in the first
    only, and most lenses lie between the two. Each family is fitted as r(arctan(k tan(theta))) to the profile of the
    model at the angles of the bearings (N, 3); the larger |log k| is returned.
    """
    theta = np.quantile(angle_from_axis(bearings), np.linspace(0, 1, FIT_ANGLES)) if len(bearings) else np.zeros(0)
    ray = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1)
    pixels, valid = model.project_numpy(np.concatenate([ray, -ray * (1, 1, -1)]))
    # Half the distance between opposite directions, because the axis itself may not be visible.
    radius = np.linalg.norm(pixels[: len(theta)] - pixels[len(theta) :], axis=1) / 2
    usable = valid.reshape(2, -1).all(0) & (radius > 0)
    if usable.sum() < MIN_FIT_ANGLES:
        return MAX_SCALE_AMBIGUITY
    theta, radius = theta[usable], radius[usable] / radius[usable].max()
    log_scales = [_fit_log_scale(family, theta, radius) for family in (_unified_profile, _tangent_profile)]
    return float(min(max(map(abs, log_scales)), MAX_SCALE_AMBIGUITY))


def has_free_radial_profile(model: CameraModel) -> bool:
    """Return whether a model has enough shape parameters to absorb a change of scale."""
    return len(set(model.param_names) - NON_SHAPE_PARAMETERS) > 1


def fix_focal_scale(free_parameters: FreeParameters, model: CameraModel, pixels: Array) -> FreeParameters:
    """Remove the combination of parameters that scales tan(theta) at the pixels (N, 2).

    Scaling moves a bearing b along t = b_z (e_z - b_z b), the parameters move it by D. The steps x with
    sum t^T D x = 0 remain. Fixing a single parameter is not equivalent: a focal length at the axis is unconstrained
    where no line comes near the axis.
    """
    bearings, valid, _, d_params = model.unproject_with_jacobians(pixels)
    valid &= np.isfinite(d_params).all((1, 2))
    b = bearings[valid]
    jacobian = d_params[valid] @ free_parameters.directions
    scaling = b[:, 2:] * (np.array([0.0, 0.0, 1.0]) - b[:, 2:] * b)
    # Parameters differ in magnitude (px, px^-3): normalise each by its effect on the bearings.
    unit = 1 / np.maximum(np.sqrt((jacobian**2).sum((0, 1))), 1e-300)
    share = np.einsum("ni,niq->q", scaling, jacobian) * unit
    kept = np.linalg.svd(share[None])[2][1:].T
    return dataclasses.replace(free_parameters, directions=free_parameters.directions @ (unit[:, None] * kept))


def _unified_profile(theta: Array, shape: float) -> Array:
    """Return r(theta) for 1/xi = exp(shape)."""
    xi = np.exp(-shape)
    return (1 + xi) * np.sin(theta) / np.maximum(xi + np.cos(theta), 1e-3)


def _tangent_profile(theta: Array, shape: float) -> Array:
    """Return r(theta) for a^2 = shape."""
    a = np.sqrt(abs(shape)) + 1e-9
    return np.tan(np.minimum(a * theta, 1.55)) / a if shape > 0 else np.tanh(a * theta) / a


def _fit_log_scale(profile: Callable[[Array, float], Array], theta: Array, radius: Array) -> float:
    """Fit log f, log k and the shape of a family to r(theta) and return log k."""

    def residuals(x: Array) -> Array:
        scaled = np.arctan2(np.exp(x[1]) * np.sin(theta), np.cos(theta))
        return np.exp(x[0]) * profile(scaled, float(x[2])) - radius

    def linearize(x: Array) -> tuple[Array, Array]:
        steps = DIFFERENCE_STEP * np.eye(3)
        columns = [(residuals(x + d) - residuals(x - d)) / (2 * DIFFERENCE_STEP) for d in steps]
        return residuals(x), np.stack(columns, -1)

    log_focal = float(np.log(radius.max() / profile(theta, 0.0).max()))
    return float(gauss_newton(linearize, np.array([log_focal, 0.0, 0.0])).state[1])
