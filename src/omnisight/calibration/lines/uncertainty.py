"""Covariance of a camera calibrated from lines, and its cross-checks: split halves and the image border."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.plumb_line import (
    PlumbLineProblem,
    PlumbLineState,
    huber_loss,
    line_sigma,
    refine_plumb_lines,
)
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.loss import Huber

Array = NDArray[np.float64]

# Eigenvalues of the scaled normal equations below this share of the largest are rounding errors.
SINGULAR_RATIO = 1e-14
# Pixels that bearing errors are averaged over.
BEARING_SAMPLES = 400
# Independent planes needed per estimated quantity for an asymptotic result: a parameter of the sandwich covariance, or
# one half of the split-half test.
MIN_PLANES = 10
# Lines with planes within this angle show one edge, or both sides of a bar: their errors are correlated.
SAME_PLANE_RAD = np.radians(1.0)
# Two estimates disagree if their difference exceeds this multiple of its standard deviation; both are then widened by
# that ratio (Birge 1932). It is the 10 % significance level of a difference in two coordinates.
BIRGE_RATIO = 1.5
# Standard deviation per axis of the border's centre from the principal point, as a share of the border's radius: twice
# the 0.4 % (rms) of the four cameras of benchmarks/lines_real.py.
BORDER_CENTRE_SIGMA = 0.009


@dataclass(frozen=True)
class LinesUncertainty(Displayed):
    """Uncertainty of the camera parameters.

    Attributes
    ----------
    covariance
        (P, P) of the parameters, zero for fixed ones.
    sigma
        Standard deviation of pixels across their lines, px.
    inflation
        Ratio of the covariance to that of independent pixels; the errors of the pixels of one edge are correlated.
    is_singular
        Whether some combination of parameters is unobservable; the covariance excludes it.
    """

    covariance: Array
    sigma: float
    inflation: float
    is_singular: bool

    @classmethod
    def estimate(
        cls, state: PlumbLineState, chains: PixelChains, free_parameters: FreeParameters
    ) -> "LinesUncertainty":
        """Estimate the covariance at a solution of `refine_plumb_lines`.

        Let H_i be the information of line i after its plane is eliminated (Schur complement), s_i its gradient and H
        the sum of H_i. For independent pixel errors the covariance is sigma^2 H^-1. The errors of one edge are
        correlated, by blur, curvature or model error, and repeat where it is seen again, so the s_i scatter more. The
        covariance is the cluster-robust sandwich H^-1 (sum s_i s_i^T) H^-1 G/(G - Q) with the G distinct planes as
        clusters (Huber 1967; White 1980; Liang and Zeger 1986). With few planes only a scalar inflation of sigma^2 H^-1
        is estimated, from the expectation of the trace:

        tr(H^-1 sum s_i s_i^T) / (sigma^2 (Q - sum tr (H^-1 H_i)^2))
        """
        sigma = line_sigma(state, chains)
        count, params = free_parameters.directions.shape[1], len(state.model.params)
        if not count:
            return cls(np.zeros((params, params)), sigma, 1.0, False)
        information, gradients = _information_by_plane(state, chains, free_parameters, huber_loss(sigma))
        planes = len(information)
        inverse, rank = _scaled_pseudo_inverse(information.sum(0))
        gradients = gradients - gradients.mean(0)  # the mean is the step that convergence left
        scatter = float(np.einsum("li,ij,lj->", gradients, inverse, gradients))
        shares = inverse @ information
        expected = rank - float(np.einsum("lij,lji->", shares, shares))
        inflation = max(scatter / (sigma**2 * max(expected, 0.1)), 1.0) if sigma > 0 else 1.0
        reduced = inverse * (sigma**2 * inflation)
        if planes >= MIN_PLANES * count and inflation > 1:
            reduced = inverse @ (gradients.T @ gradients) @ inverse * (planes / (planes - count))
        covariance = free_parameters.directions @ reduced @ free_parameters.directions.T
        return cls(covariance, sigma, inflation, rank < count)

    def widened(self, ratio: float) -> "LinesUncertainty":
        """Return the uncertainty with standard deviations times `ratio` if that exceeds `BIRGE_RATIO`."""
        if ratio < BIRGE_RATIO:
            return self
        return replace(self, covariance=self.covariance * ratio**2, inflation=self.inflation * ratio**2)


def bearing_sigma(model: CameraModel, covariance: Array, pixels: Array) -> float:
    """Return the standard deviation (radians, rms) of the bearings of pixels (N, 2), up to a rotation of the camera."""
    samples = pixels[np.unique(np.linspace(0, len(pixels) - 1, BEARING_SAMPLES).round().astype(np.intp))]
    bearings, valid, _, d_params = model.unproject_with_jacobians(samples)
    valid &= np.isfinite(d_params).all((1, 2))
    if not valid.any():
        return np.inf
    b, jacobian = bearings[valid], d_params[valid].reshape(-1, d_params.shape[-1])
    d_rotation = so3.hat(b).reshape(-1, 3)
    jacobian = jacobian - d_rotation @ np.linalg.lstsq(d_rotation, jacobian, rcond=None)[0]
    return float(np.sqrt(np.einsum("ni,ij,nj->", jacobian, covariance, jacobian) / len(b)))


def bearing_difference(first: CameraModel, second: CameraModel, pixels: Array) -> float:
    """Return the angle (radians, rms) between the bearings of two cameras at pixels (N, 2), after a best rotation."""
    a, valid_a = first.unproject_numpy(pixels)
    b, valid_b = second.unproject_numpy(pixels)
    a, b = a[valid_a & valid_b], b[valid_a & valid_b]
    if not len(a):
        return float(np.pi)
    rotated = a @ so3.nearest(b.T @ a).T
    return float(np.sqrt(((rotated - b) ** 2).sum(1).mean()))


def widen_by_split_half_test(
    uncertainty: LinesUncertainty, state: PlumbLineState, chains: PixelChains, free_parameters: FreeParameters
) -> LinesUncertainty:
    """Widen the covariance if two halves of the lines differ by more than it predicts.

    Lines of one plane belong to one half, because their errors are correlated.
    """
    plane = group_planes(state.normals)
    if uncertainty.is_singular or plane.max() + 1 < 2 * MIN_PLANES:
        return uncertainty
    models, predicted = [], 0.0
    for half in (0, 1):
        indices = np.flatnonzero(plane % 2 == half)
        part = chains.subset(indices)
        refined = refine_plumb_lines(PlumbLineState(state.model, state.normals[indices]), part, free_parameters).state
        own = LinesUncertainty.estimate(refined, part, free_parameters)
        predicted += bearing_sigma(refined.model, own.covariance, chains.pixels) ** 2
        models.append(refined.model)
    difference = bearing_difference(models[0], models[1], chains.pixels)
    return uncertainty.widened(difference / max(float(np.sqrt(predicted)), 1e-12))


def update_with_border_centre(
    model: CameraModel, uncertainty: LinesUncertainty, border_centre: Array, pixels: Array
) -> tuple[CameraModel, LinesUncertainty]:
    """Update a camera with the centre (2,) of the image border as a measurement of the principal point.

    A Kalman update (Kalman 1960) with the estimated covariance, which includes correlated errors of the lines. If lines
    and border disagree, the result is widened. The farthest of the lines' pixels (N, 2) gives the border's radius.
    """
    names = model.param_names
    if not {"cx", "cy"} <= set(names):
        return model, uncertainty
    at = [names.index("cx"), names.index("cy")]
    sigma = BORDER_CENTRE_SIGMA * float(np.linalg.norm(pixels - border_centre, axis=1).max())
    covariance = uncertainty.covariance
    innovation = border_centre - model.params[at]
    information = np.linalg.inv(covariance[np.ix_(at, at)] + sigma**2 * np.eye(2))
    gain = covariance[:, at] @ information
    ratio = float(np.sqrt(innovation @ information @ innovation / 2))
    low, high = np.array([(p.low, p.high) for p in model.parameters]).T
    updated = model.with_params(np.clip(model.params + gain @ innovation, low, high))
    return updated, replace(uncertainty, covariance=covariance - gain @ covariance[at]).widened(ratio)


def fix_principal_point(free_parameters: FreeParameters, model: CameraModel) -> FreeParameters:
    """Remove the combinations of parameters that move the principal point."""
    at = [i for i, name in enumerate(model.param_names) if name in ("cx", "cy")]
    rows = free_parameters.directions[at]
    kept = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :].T
    return replace(free_parameters, directions=free_parameters.directions @ kept)


def group_planes(normals: Array) -> NDArray[np.intp]:
    """Return a group index for each plane (L,); planes within `SAME_PLANE_RAD` share a group."""
    is_same = np.abs(normals @ normals.T) > np.cos(SAME_PLANE_RAD)
    group = np.full(len(normals), -1, np.intp)
    for i in range(len(normals)):
        if group[i] < 0:
            group[is_same[i] & (group < 0)] = group.max() + 1
    return group


def _information_by_plane(
    state: PlumbLineState, chains: PixelChains, free_parameters: FreeParameters, loss: Huber
) -> tuple[Array, Array]:
    """Return the camera information (G, Q, Q) and gradient (G, Q) of each distinct plane, its normal eliminated."""
    plane = group_planes(state.normals)
    planes, count = int(plane.max()) + 1, free_parameters.directions.shape[1]
    information, gradients = np.zeros((planes, count, count)), np.zeros((planes, count))
    for line in range(len(chains)):
        problem = PlumbLineProblem(chains.subset([line]), loss, free_parameters)
        normal = problem.linearize(PlumbLineState(state.model, state.normals[line][None]))
        schur, gradient, _, _ = normal.reduced()
        unobserved = np.diagonal(normal.shared) <= 0
        schur[unobserved], schur[:, unobserved] = 0.0, 0.0
        information[plane[line]] += schur
        gradients[plane[line]] += gradient
    return information, gradients


def _scaled_pseudo_inverse(information: Array) -> tuple[Array, int]:
    """Return the pseudo-inverse of an information matrix, scaled to a unit diagonal, and its rank."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    observed = values > SINGULAR_RATIO * values[-1]
    half = (vectors[:, observed] / np.sqrt(values[observed])) * scale[:, None]
    return half @ half.T, int(observed.sum())
