"""Circles as images of lines, and the parabolic camera that they determine."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.models.unified import Unified

Array = NDArray[np.float64]

FEWEST = 3


@dataclass(frozen=True)
class Circle:
    """A circle, or a straight line, fitted to pixels: A (u^2 + v^2) + B u + C v + D = 0.

    Attributes
    ----------
    coefficients
        (4,) A, B, C, D with B^2 + C^2 - 4 A D = 1, so that the left side's gradient has length 1 on the circle.
    covariance
        (4, 4) for pixels with noise of 1 px.
    """

    coefficients: Array
    covariance: Array

    def distance(self, pixels: Array) -> Array:
        """Give the signed distance (px) of pixels (..., 2) from the circle.

        d = 2 F/(1 + sqrt(1 + 4 A F)), exact, and regular where the circle is a line (Chernov, Circular and linear
        regression, 2010, eq. 3.16).
        """
        return _distance(self.coefficients, pixels)


def fit_circle(pixels: Array, *, iterations: int = 10) -> Circle:
    """Fit a circle to pixels (n, 2) with the least squared distance, be the arc long, short or straight.

    Begins with Pratt's algebraic fit (Direct least-squares fitting of algebraic surfaces, SIGGRAPH 1987) and goes on by
    Gauss-Newton on the four coefficients under their constraint: neither centre nor radius is ever divided by.
    """
    middle = pixels.mean(0)
    size = float(np.sqrt(((pixels - middle) ** 2).sum(1).mean())) or 1.0
    q = (pixels - middle) / size
    design = np.column_stack([(q**2).sum(1), q, np.ones(len(q))])
    p = _pratt(design)
    normal = np.eye(3)
    basis = np.eye(4)[:, 1:]
    for _ in range(iterations):
        f = design @ p
        root = np.sqrt(np.maximum(1 + 4 * p[0] * f, 1e-12))
        d = 2 * f / (1 + root)
        # From A d^2 + d = F:  dd = (dF - d^2 dA)/(1 + 2 A d).
        slope = design.copy()
        slope[:, 0] -= d * d
        basis = _tangents(p)
        j = (slope @ basis) / root[:, None]
        normal = j.T @ j
        step = np.linalg.lstsq(j, -d, rcond=None)[0]
        p = _normalised(p + basis @ step)
        if np.abs(step).max() < 1e-10:
            break
    covariance = basis @ np.linalg.pinv(normal) @ basis.T
    # Back to pixels: u = size x + middle, and lengths grow by size.
    back = np.zeros((4, 4))
    back[0, 0] = 1 / size
    back[1:3, 0], back[1:3, 1:3] = -2 * middle / size, np.eye(2)
    back[3] = [middle @ middle / size, *-middle, size]
    found = back @ p
    return Circle(found, back @ covariance @ back.T / size**2)


def parabolic_camera(circles: Sequence[Circle]) -> Unified | None:
    """Give the camera of a parabolic mirror from the images of three or more lines; None where they make none.

    The image of a line with the normal n is the circle of centre c + f (n_x, n_y)/n_z and radius f/n_z (its sign
    aside). So f^2 = R^2 - |a - c|^2 for each circle of centre a: the principal point has the same power -f^2 with
    respect to all circles, it is their radical centre (Geyer and Daniilidis, Paracatadioptric camera calibration, PAMI
    2002). In coefficients A w + B c_x + C c_y + D = 0 with w = |c|^2 + f^2: all line images lie on one hyperplane
    (Barreto and Araujo, Fitting conics to paracatadioptric projections of lines, CVIU 2006), which three circles
    determine and more overdetermine; each counts by what its arc tells of it.
    """
    if len(circles) < FEWEST:
        return None
    rows = np.array([circle.coefficients for circle in circles])
    weight = np.ones(len(rows))
    w, cx, cy = 0.0, 0.0, 0.0
    for _ in range(8):
        (w, cx, cy), _, rank, _ = np.linalg.lstsq(rows[:, :3] * weight[:, None], -rows[:, 3] * weight, rcond=1e-12)
        if rank < 3:
            return None
        h = np.array([w, cx, cy, 1.0])
        weight = 1 / np.sqrt([max(float(h @ circle.covariance @ h), 1e-12) for circle in circles])
    f2 = w - cx**2 - cy**2
    if not f2 > 0:
        return None
    return Unified(float(np.sqrt(f2)), float(np.sqrt(f2)), float(cx), float(cy), 1.0)


def _pratt(design: Array) -> Array:
    """Give the coefficients that minimise the algebraic distance under Pratt's constraint B^2 + C^2 - 4 A D = 1."""
    constraint = np.zeros((4, 4))
    constraint[1, 1] = constraint[2, 2] = 1.0
    constraint[0, 3] = constraint[3, 0] = -2.0
    scatter = design.T @ design
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, scatter))
    values, vectors = np.real(values), np.real(vectors)
    norms = np.einsum("ik,ij,jk->k", vectors, constraint, vectors)
    least = np.argmin(np.where(norms > 1e-12, np.abs(values), np.inf))
    return _normalised(vectors[:, least])


def _normalised(p: Array) -> Array:
    norm = p[1] ** 2 + p[2] ** 2 - 4 * p[0] * p[3]
    return p / np.sqrt(max(norm, 1e-12))


def _tangents(p: Array) -> Array:
    """Give a basis (4, 3) of the steps that keep the constraint."""
    gradient = np.array([-2 * p[3], p[1], p[2], -2 * p[0]])
    return np.linalg.svd(gradient[None])[2][1:].T


def _distance(p: Array, pixels: Array) -> Array:
    u, v = pixels[..., 0], pixels[..., 1]
    f = p[0] * (u * u + v * v) + p[1] * u + p[2] * v + p[3]
    return 2 * f / (1 + np.sqrt(np.maximum(1 + 4 * p[0] * f, 0.0)))
