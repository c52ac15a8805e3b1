"""How well lines determine a camera."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.plumb import HUBER_SIGMAS, Lines, PlumbLine, line_sigma
from omnisight.geometry import rotation as so3
from omnisight.models import CameraModel
from omnisight.optim.loss import Huber

Array = NDArray[np.float64]

# Of normal equations with a unit diagonal: what is so much smaller than the largest eigenvalue is rounding.
SINGULAR = 1e-14
BEARINGS = 400
# Planes for each parameter that is estimated, with which their scatter tells a whole matrix and not only its size.
PLENTY = 10
# Planes so close (radians) are of one edge, or of the two sides of a bar.
ONE_PLANE = np.radians(1.0)


@dataclass(frozen=True)
class Uncertainty:
    """What the lines say of the camera's parameters, and how surely.

    Attributes
    ----------
    covariance
        (P, P) of the parameters, zero for those that stood still.
    sigma
        Standard deviation of pixels across their lines, px.
    inflation
        How much larger the covariance is than independent pixels would have it: the pixels of one edge err together.
    singular
        Whether some combination of the parameters moves no image of a line at all; the covariance is then without it.
    """

    covariance: Array
    sigma: float
    inflation: float
    singular: bool

    @classmethod
    def of(cls, state: Lines, chains: Chains, freedom: Freedom) -> "Uncertainty":
        """Weigh a solution of `refine_lines`.

        With H_i what line i says of the camera once its own plane is eliminated (its Schur complement) and s_i its
        gradient, the covariance is sigma^2 H^-1, H the sum of H_i, if pixels err independently. They do not: one edge
        is blurred, or not straight, or the model bends it, as a whole, and a second picture of it errs as the first.
        Then the s_i scatter more than sigma^2 H_i, and the covariance is H^-1 (sum s_i s_i^T) H^-1 G/(G - Q), lines as
        clusters, those of nearly one plane together (the sandwich: Huber 1967, White 1980; for clusters Liang and Zeger
        1986; the factor for few of them as usual). Few planes do not tell so much; then it is one factor on sigma^2
        H^-1, the inflation, whose trace is its expectation for independent pixels:

        tr(H^-1 sum s_i s_i^T) / (sigma^2 (Q - sum tr (H^-1 H_i)^2))
        """
        sigma = line_sigma(state, chains)
        loss = Huber(max(HUBER_SIGMAS * sigma, 1e-3))
        count = freedom.directions.shape[1]
        names = len(state.model.params)
        if not count:
            return cls(np.zeros((names, names)), sigma, 1.0, False)
        said = [_said(state, chains, i, freedom, loss) for i in range(len(chains))]
        plane = alike(state.normals)
        planes = int(plane.max()) + 1
        each, slopes = np.zeros((planes, count, count)), np.zeros((planes, count))
        np.add.at(each, plane, np.array([h for h, _ in said]))
        np.add.at(slopes, plane, np.array([s for _, s in said]))
        total = each.sum(0)
        scale = 1 / np.sqrt(np.maximum(np.diagonal(total), 1e-300))
        values, vectors = np.linalg.eigh(total * scale[:, None] * scale)
        known = values > SINGULAR * values[-1]
        half = (vectors[:, known] / np.sqrt(values[known])) * scale[:, None]
        inverse = half @ half.T
        slopes = slopes - slopes.mean(0)  # zero but for the last step that was not taken
        scatter = float(np.einsum("li,ij,lj->", slopes, inverse, slopes))
        shares = inverse @ each
        expected = int(known.sum()) - float(np.einsum("lij,lji->", shares, shares))
        inflation = max(scatter / (sigma**2 * max(expected, 0.1)), 1.0) if sigma > 0 else 1.0
        spread = inverse * (sigma**2 * inflation)
        if planes >= PLENTY * count and inflation > 1:
            spread = inverse @ (slopes.T @ slopes) @ inverse * (planes / (planes - count))
        covariance = freedom.directions @ spread @ freedom.directions.T
        return cls(covariance, sigma, inflation, bool(not known.all()))

    def times(self, factor: float) -> "Uncertainty":
        """Give it with deviations so many times larger."""
        return replace(self, covariance=self.covariance * factor**2, inflation=self.inflation * factor**2)


def bearing_deviation(model: CameraModel, covariance: Array, pixels: Array) -> float:
    """Give the standard deviation (radians, rms over pixels) of the bearings that a camera gives to pixels (N, 2).

    A turn of the camera is taken out: what it is looked at with has its own direction.
    """
    some = pixels[np.unique(np.linspace(0, len(pixels) - 1, BEARINGS).round().astype(np.intp))]
    bearings, valid, _, d_params = model.unproject_with_jacobians(some)
    valid &= np.isfinite(d_params).all((1, 2))
    if not valid.any():
        return np.inf
    b, slopes = bearings[valid], d_params[valid].reshape(-1, d_params.shape[-1])
    turns = so3.hat(b).reshape(-1, 3)
    slopes = slopes - turns @ np.linalg.lstsq(turns, slopes, rcond=None)[0]
    return float(np.sqrt(np.einsum("ni,ij,nj->", slopes, covariance, slopes) / len(b)))


def alike(normals: Array) -> NDArray[np.intp]:
    """Number planes (L,) so that those of nearly one direction share a number."""
    near = np.abs(normals @ normals.T) > np.cos(ONE_PLANE)
    number = np.full(len(normals), -1, np.intp)
    for i in range(len(normals)):
        if number[i] < 0:
            number[near[i] & (number < 0)] = number.max() + 1
    return number


def _said(state: Lines, chains: Chains, line: int, freedom: Freedom, loss: Huber) -> tuple[Array, Array]:
    """Give what one line says of the camera, its own plane eliminated: H_i (Q, Q) and its gradient (Q,)."""
    problem = PlumbLine(chains.subset([line]), loss, freedom)
    normal = problem.linearise(Lines(state.model, state.normals[line][None]))
    schur, gradient, _, _ = normal.reduced()
    silent = np.diagonal(normal.shared) <= 0
    schur[silent], schur[:, silent] = 0.0, 0.0
    return schur, gradient
