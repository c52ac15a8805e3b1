"""Images of lines as conics and circles, and the parabolic camera that circles determine."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models.unified import Unified
from omnisight.optim.gauss_newton import gauss_newton

Array = NDArray[np.float64]

# Three circles have one radical centre.
MIN_CIRCLES = 3
# Keeps divisions by squared lengths of normalised coefficients finite.
EPSILON = 1e-12


@dataclass(frozen=True)
class Circle:
    """A circle or straight line fitted to pixels: A (u^2 + v^2) + B u + C v + D = 0.

    Attributes
    ----------
    coefficients
        (4,) A, B, C, D with B^2 + C^2 - 4 A D = 1: the gradient of the left side has length 1 on the circle.
    covariance
        (4, 4) covariance of the coefficients for pixel noise of 1 px.
    """

    coefficients: Array
    covariance: Array

    def distance(self, pixels: Array) -> Array:
        """Return the signed distance (px) of pixels (..., 2) from the circle.

        d = 2 F/(1 + sqrt(1 + 4 A F)) is exact and regular for straight lines (Chernov, Circular and linear regression,
        2010, eq. 3.16).
        """
        p, u, v = self.coefficients, pixels[..., 0], pixels[..., 1]
        f = p[0] * (u * u + v * v) + p[1] * u + p[2] * v + p[3]
        return 2 * f / (1 + np.sqrt(np.maximum(1 + 4 * p[0] * f, 0.0)))


def line_conic(model: Unified, normal: ArrayLike) -> Array:
    """Return the conic Omega (3, 3) of the image of a line: p^T Omega p = 0 for pixels p = (u, v, 1).

    Parameters
    ----------
    model
        A camera of the unified model.
    normal
        (3,) normal of the plane through the viewpoint and the line, of any length.

    Notes
    -----
    A point m = (x, y, 1) of the normalised plane is the point P = lambda m - xi e_z of the sphere. Eliminating lambda
    from n . P = 0 and |P| = 1 gives

    xi^2 n_z^2 m.m - 2 xi^2 n_z (n.m) + (xi^2 - 1) (n.m)^2 = 0,

    with m = K^-1 p (Barreto and Araujo, Geometric properties of central catadioptric line images and their application
    in calibration, PAMI 2005, eq. 6, with the opposite sign). The conic is a circle for xi = 1 and a double line for
    xi = 0. It contains the image of the whole great circle and of its reflection through the second viewpoint, so half
    of it may lie outside the image of the camera.
    """
    n = np.asarray(normal, float)
    n = n / np.linalg.norm(n)
    xi2, nz = model.xi**2, n[2]
    n_ez = np.outer(n, (0.0, 0.0, 1.0))
    omega = xi2 * nz**2 * np.eye(3) - xi2 * nz * (n_ez + n_ez.T) + (xi2 - 1) * np.outer(n, n)
    k = np.array([[model.fx, model.skew, model.cx], [0.0, model.fy, model.cy], [0.0, 0.0, 1.0]])
    k_inverse = np.linalg.inv(k)
    return k_inverse.T @ omega @ k_inverse


def fit_circle(pixels: Array, *, iterations: int = 10) -> Circle:
    """Fit a circle to pixels (n, 2) by least squared distance; short and straight arcs are allowed.

    Starts from Pratt's algebraic fit (Direct least-squares fitting of algebraic surfaces, SIGGRAPH 1987), then runs
    Gauss-Newton on the four coefficients under their constraint. Neither the centre nor the radius is divided by.
    """
    mean = pixels.mean(0)
    scale = float(np.sqrt(((pixels - mean) ** 2).sum(1).mean())) or 1.0
    q = (pixels - mean) / scale
    design = np.column_stack([(q**2).sum(1), q, np.ones(len(q))])
    solution = gauss_newton(
        lambda p: _linearize_distance(design, p),
        _pratt_fit(design),
        retract=lambda p, step: _normalize(p + _tangent_basis(p) @ step),
        max_iterations=iterations,
    )
    p, basis = solution.state, _tangent_basis(solution.state)
    covariance = basis @ np.linalg.pinv(solution.hessian) @ basis.T
    # Coefficients in pixels: u = scale q + mean, and lengths grow by `scale`.
    to_pixels = np.zeros((4, 4))
    to_pixels[0, 0] = 1 / scale
    to_pixels[1:3, 0], to_pixels[1:3, 1:3] = -2 * mean / scale, np.eye(2)
    to_pixels[3] = [mean @ mean / scale, *-mean, scale]
    return Circle(to_pixels @ p, to_pixels @ covariance @ to_pixels.T / scale**2)


def parabolic_camera(circles: Sequence[Circle]) -> Unified | None:
    """Return the camera of a parabolic mirror from the images of three or more lines, or None if they determine none.

    The image of a line with plane normal n is the circle of centre c + f (n_x, n_y)/n_z and radius f/|n_z|. For every
    circle of centre a and radius R, f^2 = R^2 - |a - c|^2: the principal point has the power -f^2 with respect to all
    circles, so it is their radical centre (Geyer and Daniilidis, Paracatadioptric camera calibration, PAMI 2002). In
    coefficients, A w + B c_x + C c_y + D = 0 with w = |c|^2 + f^2 is linear in (w, c_x, c_y) (Barreto and Araujo,
    Fitting conics to paracatadioptric projections of lines, CVIU 2006). Each equation is weighted by the covariance of
    its circle.
    """
    if len(circles) < MIN_CIRCLES:
        return None
    rows = np.array([circle.coefficients for circle in circles])
    weight = np.ones(len(rows))
    w, cx, cy = 0.0, 0.0, 0.0
    for _ in range(8):
        (w, cx, cy), _, rank, _ = np.linalg.lstsq(rows[:, :3] * weight[:, None], -rows[:, 3] * weight, rcond=EPSILON)
        if rank < 3:
            return None
        h = np.array([w, cx, cy, 1.0])
        weight = 1 / np.sqrt([max(float(h @ circle.covariance @ h), EPSILON) for circle in circles])
    f2 = w - cx**2 - cy**2
    if not f2 > 0:
        return None
    return Unified(float(np.sqrt(f2)), float(np.sqrt(f2)), float(cx), float(cy), 1.0)


def _linearize_distance(design: Array, p: Array) -> tuple[Array, Array]:
    """Return the distances (n,) and their Jacobian (n, 3) by steps along the constraint."""
    f = design @ p
    root = np.sqrt(np.maximum(1 + 4 * p[0] * f, EPSILON))
    d = 2 * f / (1 + root)
    # From A d^2 + d = F: dd = (dF - d^2 dA)/(1 + 2 A d).
    d_coefficients = design.copy()
    d_coefficients[:, 0] -= d * d
    return d, (d_coefficients @ _tangent_basis(p)) / root[:, None]


def _pratt_fit(design: Array) -> Array:
    """Minimise the algebraic distance under Pratt's constraint B^2 + C^2 - 4 A D = 1."""
    constraint = np.zeros((4, 4))
    constraint[1, 1] = constraint[2, 2] = 1.0
    constraint[0, 3] = constraint[3, 0] = -2.0
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, design.T @ design))
    values, vectors = np.real(values), np.real(vectors)
    norms = np.einsum("ik,ij,jk->k", vectors, constraint, vectors)
    smallest = np.argmin(np.where(norms > EPSILON, np.abs(values), np.inf))
    return _normalize(vectors[:, smallest])


def _normalize(p: Array) -> Array:
    """Scale coefficients to B^2 + C^2 - 4 A D = 1."""
    return p / np.sqrt(max(p[1] ** 2 + p[2] ** 2 - 4 * p[0] * p[3], EPSILON))


def _tangent_basis(p: Array) -> Array:
    """Return a basis (4, 3) of the steps that keep the constraint to first order."""
    gradient = np.array([-2 * p[3], p[1], p[2], -2 * p[0]])
    return np.linalg.svd(gradient[None])[2][1:].T
