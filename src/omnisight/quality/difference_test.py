"""Test of the difference of two cameras against their uncertainties."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.geometry import rotation as so3

Array = NDArray[np.float64]

# Components of the difference that are tested one by one have at least this share of its expected variance: in smaller
# ones, the difference of two models exceeds the uncertainty of their parameters.
MIN_PRINCIPAL_FRACTION = 1e-3


@dataclass(frozen=True)
class DifferenceTest(Displayed):
    """Test of the difference of two cameras against what their uncertainties predict for equal ones.

    To first order, the difference at bearing k is d_k = J_bk e_b - J_ak e_a + R_k w with the errors e of the parameters
    and a rotation w. The best rotation projects the errors onto the complement of the columns of R. The mean of |d_k|^2
    is then a sum of chi-square variables with the eigenvalues of the covariance as weights. This test alone has little
    power if one eigenvalue dominates, so the principal components of the difference are tested too.

    Attributes
    ----------
    p_value
        Probability of at least this difference if the cameras are equal and were calibrated from different images; NaN
        if no uncertainty is known.
    expected_rms
        Root mean square that the uncertainties predict for equal cameras, px; NaN if unknown.
    is_of_component
        Whether the principal components decide, and not the mean.
    component_rms, component_expected_rms
        Root mean square (px) of the component that is largest relative to its uncertainty, and its expected value.
    """

    p_value: float = float("nan")
    expected_rms: float = float("nan")
    is_of_component: bool = False
    component_rms: float = float("nan")
    component_expected_rms: float = float("nan")

    @classmethod
    def of(cls, a: Camera, b: Camera, of_a: Array, of_b: Array) -> Self:
        """Test the difference at the same directions (N, 3) in the frames of two cameras, after the best rotation."""
        factors = [_factor(camera, at) for camera, at in ((a, of_a), (b, of_b)) if has_uncertainty(camera)]
        if not factors:
            return cls()
        projected, _, d_point, _ = b.model.project_with_jacobians(of_b)
        difference = (projected - a.project(of_a)[0]).ravel()
        by_rotation = (-d_point @ so3.hat(of_b)).reshape(-1, 3)
        errors = np.concatenate(factors, axis=1)
        use = np.isfinite(errors).all(1) & np.isfinite(by_rotation).all(1) & np.isfinite(difference)
        errors, by_rotation, difference = errors[use], by_rotation[use], difference[use]
        errors = errors - by_rotation @ np.linalg.lstsq(by_rotation, errors, rcond=None)[0]
        modes, sizes, _ = np.linalg.svd(errors, full_matrices=False)
        count = len(errors) / 2
        weights = sizes**2 / count
        of_mean = chi_square_mixture_tail(float((difference**2).sum() / count), weights)
        principal = weights > MIN_PRINCIPAL_FRACTION * weights.sum()
        along, sizes = (difference @ modes)[principal], sizes[principal]
        of_components = chi_square_tail(float(((along / sizes) ** 2).sum()), len(along))
        largest = int(np.abs(along / sizes).argmax())
        return cls(
            min(1.0, 2 * min(of_mean, of_components)),  # Bonferroni
            float(np.sqrt(weights.sum())),
            of_components < of_mean,
            float(np.abs(along[largest]) / np.sqrt(count)),
            float(sizes[largest] / np.sqrt(count)),
        )


def has_uncertainty(camera: Camera) -> bool:
    """Return whether the uncertainty of a camera is known: zero is that of parameters that were not estimated."""
    return camera.covariance is not None and bool(np.any(camera.covariance))


def _factor(camera: Camera, bearings: Array) -> Array:
    """Return a factor F (2 N, P) of the covariance F F^T of the pixels of bearings (N, 3), with a fixed frame."""
    assert camera.covariance is not None
    _, _, _, d_params = camera.model.project_with_jacobians(bearings)
    values, vectors = np.linalg.eigh(camera.covariance)
    return (d_params @ (vectors * np.sqrt(np.maximum(values, 0.0)))).reshape(2 * len(bearings), -1)


def chi_square_tail(value: float, degrees_of_freedom: float) -> float:
    """Return the probability that a chi-square variable exceeds a value."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees_of_freedom, max(value, 0.0)))


def chi_square_mixture_tail(value: float, weights: Array) -> float:
    """Return the probability that a weighted sum of chi-square variables of one degree of freedom exceeds a value.

    Pearson's approximation by a chi-square variable with the same first three moments (Imhof, Computing the
    distribution of quadratic forms in normal variables, Biometrika 48, 1961, sec. 4).
    """
    c1, c2, c3 = (float((weights**k).sum()) for k in (1, 2, 3))
    degrees_of_freedom = c2**3 / c3**2
    scaled = (value - c1) * np.sqrt(degrees_of_freedom / c2) + degrees_of_freedom
    return chi_square_tail(float(scaled), degrees_of_freedom)
