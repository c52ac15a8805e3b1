"""Rotation between two panoramas about the vertical axis, from their appearance."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.display import named_tuple_text
from omnisight.places.panorama_signature import Array, PanoramaSignature, normalized
from omnisight.places.rotation_ambiguity import ambiguity, periodic, sector_edges

# Samples of the correlation per column: its maximum is then within the basin of the refinement.
OVERSAMPLING = 4
# Gauss-Newton steps, and the step of the rotation, columns, at which they end: far below its standard deviation.
MAX_ITERATIONS, STEP_COLUMNS = 20, 1e-5
# Halvings of a step that does not decrease the cost.
MAX_HALVINGS = 5
# Common columns below which a rotation is not considered.
MIN_COMMON_COLUMNS = 8
# References whose correlations are computed at once, which bounds the memory.
CHUNK = 64
# Error of the rotation relative to the displacement of columns by a translation, because the surroundings are not at
# equal distance: 0.07 to 0.13 (68 %) in rendered rooms and streets, 0.12 to 0.16 outdoors.
DISPLACEMENT_ERROR = 0.12


class CompassRotation(NamedTuple):
    """Rotation of a panorama from another one.

    Attributes
    ----------
    yaw_deg
        Heading of the second image minus that of the first, within -180 to 180; positive is clockwise from above.
    sigma_deg
        Standard deviation of `yaw_deg`. It includes the probability of other maxima of the correlation.
    similarity
        Correlation coefficient of the panoramas after the rotation, at most 1.
    """

    yaw_deg: float
    sigma_deg: float
    similarity: float

    __repr__ = named_tuple_text

    def deviation(self, b_from_a: Array, level_from_camera: Array | None = None) -> float:
        """Return the difference from a rotation of bearings, in standard deviations.

        Parameters
        ----------
        b_from_a
            (3, 3) rotation of bearings from the first camera to the second, such as that of visual odometry. Only its
            part about the vertical axis is compared.
        level_from_camera
            (3, 3) rotation of bearings from the camera to a level frame (y down), see `look`; identity by default.
        """
        level = np.eye(3) if level_from_camera is None else np.asarray(level_from_camera, float)
        a_from_b = level @ np.asarray(b_from_a, float).T @ level.T
        yaw = np.arctan2(a_from_b[0, 2] - a_from_b[2, 0], a_from_b[0, 0] + a_from_b[2, 2])
        return abs(wrap_deg(float(np.degrees(yaw)) - self.yaw_deg)) / max(self.sigma_deg, np.finfo(float).tiny)


class _Fit(NamedTuple):
    """Parameters (3,), columns: rotation and displacement; residuals (H, W) and Jacobian (3, H, W)."""

    parameters: Array
    residuals: Array
    jacobian: Array

    @property
    def cost(self) -> float:
        """Sum of the squared residuals, 1 without any similarity."""
        return float((self.residuals**2).sum())


class _Estimate(NamedTuple):
    """A fit and the variance of its rotation, columns squared."""

    fit: _Fit
    variance: float


def correlations(query: PanoramaSignature, references: Sequence[PanoramaSignature]) -> Array:
    """Return the correlation coefficients (N, OVERSAMPLING W) of a panorama with others after every rotation.

    Where columns are not observed, they are those of the common columns, reduced to the coefficients of the same
    likelihood for the largest number of common columns.
    """
    is_whole = all(each.observed.all() for each in (query, *references))
    correlate = _correlations if is_whole else _common_correlations
    parts = [references[k : k + CHUNK] for k in range(0, len(references), CHUNK)]
    found = np.concatenate([correlate(query, part) for part in parts])
    if not is_whole:
        common = _columns(query.mask_spectrum.conj() * np.stack([each.mask_spectrum for each in references]), query)
        exponent = common / common.max()
        found *= common > MIN_COMMON_COLUMNS - 0.5
        found = np.sign(found) * np.sqrt(1 - (1 - np.minimum(found**2, 1.0)) ** exponent)
    columns = query.values.shape[1]
    transformed = np.fft.rfft(found, axis=1)
    transformed[:, columns // 2 + 1 :] = 0
    return OVERSAMPLING * np.fft.irfft(transformed, n=OVERSAMPLING * columns, axis=1)


def _correlations(query: PanoramaSignature, references: Sequence[PanoramaSignature]) -> Array:
    """Return correlation coefficients (N, W) of panoramas without masks."""
    return _columns(_products(query, references), query)


def _products(query: PanoramaSignature, references: Sequence[PanoramaSignature]) -> NDArray[np.complex64]:
    """Return the products (N, F) of spectra, summed over the rows."""
    return np.stack([np.einsum("hf,hf->f", query.spectrum.conj(), each.spectrum) for each in references])


def _columns(products: NDArray[np.complexfloating], query: PanoramaSignature) -> Array:
    """Return circular correlations (..., W) from products of spectra (..., F)."""
    return np.fft.irfft(products, n=query.values.shape[1], axis=-1)


def _common_correlations(query: PanoramaSignature, references: Sequence[PanoramaSignature]) -> Array:
    """Return correlation coefficients (N, W) of the common columns, without the means of the rows of these.

    D. Padfield, Masked object registration in the Fourier domain, IEEE Trans. Image Processing 21(5), 2012.
    """
    spectra = np.stack([each.spectrum for each in references])
    masks = np.stack([each.mask_spectrum for each in references])
    energies = np.stack([each.energy_spectrum for each in references])
    common = np.maximum(_columns(query.mask_spectrum.conj() * masks, query), 1.0)
    sums_q = _columns(query.spectrum.conj() * masks[:, None], query)  # (N, H, W)
    sums_r = _columns(query.mask_spectrum.conj() * spectra, query)
    products = _columns(_products(query, references), query)
    energy_q = _columns(query.energy_spectrum.conj() * masks, query) - (sums_q**2).sum(axis=1) / common
    energy_r = _columns(query.mask_spectrum.conj() * energies, query) - (sums_r**2).sum(axis=1) / common
    # Of uniform columns only rounding errors are left, of energies whose sum over all columns is 1.
    norm = np.sqrt(np.maximum(energy_q, 1e-5) * np.maximum(energy_r, 1e-5))
    return np.clip((products - (sums_q * sums_r).sum(axis=1) / common) / norm, -1.0, 1.0)


def estimate_rotation(
    query: PanoramaSignature, reference: PanoramaSignature, correlation: Array | None = None
) -> CompassRotation:
    """Estimate the rotation of a panorama from a reference.

    The maximum of the circular correlation is refined together with the displacement of the columns that a translation
    causes: its first harmonic, exact to first order for surroundings at equal distance (M. O. Franz et al., Where did I
    take that snapshot?, Biological Cybernetics 79, 1998). This is done for white residuals, and again for residuals
    with the power that each octave has in the first estimate, because light and distances change low and high
    frequencies differently. The estimate of the smaller variance is returned, with the variance of a mixture of both.

    Parameters
    ----------
    query, reference
        Panoramas of the same size whose columns cover 360 degrees clockwise.
    correlation
        The result of `correlations`, if it is known.

    Returns
    -------
    The rotation from the reference to the query.
    """
    found = correlations(query, [reference])[0] if correlation is None else correlation
    start = _at_maximum(found)
    coarse = _refine(query.smoothed, reference.smoothed, start).parameters
    fit = _best_fit(query, reference, (start, coarse))
    estimates = [_Estimate(fit, _total_variance(fit, query, reference))]
    power = _octave_power(fit.residuals)
    if power.all():
        white_query, white_reference = (each.filtered(1 / np.sqrt(power)) for each in (query, reference))
        correlated = correlations(white_query, [white_reference])[0]
        refit = _best_fit(white_query, white_reference, (fit.parameters, _at_maximum(correlated)))
        estimates.append(_Estimate(refit, _total_variance(refit, white_query, white_reference)))
        fit = min(estimates, key=lambda each: each.variance).fit
    columns = query.values.shape[1]
    degrees = 360.0 / columns
    similarity = float(np.sqrt(max(0.0, 1.0 - _evaluate(query, reference, fit.parameters).cost)))
    sigma = float(np.sqrt(_mixture_variance(estimates, columns))) * degrees
    return CompassRotation(wrap_deg(float(fit.parameters[0]) * degrees), sigma, similarity)


def _at_maximum(correlation: Array) -> Array:
    """Return the parameters of the rotation with the largest correlation, without displacement."""
    return np.array([correlation.argmax() / OVERSAMPLING, 0.0, 0.0])


def _best_fit(query: PanoramaSignature, reference: PanoramaSignature, starts: Sequence[Array]) -> _Fit:
    """Return the fit of the smallest cost from several initial parameters."""
    return min((_refine(query, reference, start) for start in starts), key=lambda fit: fit.cost)


def _total_variance(fit: _Fit, query: PanoramaSignature, reference: PanoramaSignature) -> float:
    """Return the variance of the rotation of a fit, columns squared."""
    displacement = float(np.hypot(*fit.parameters[1:]))
    other_maxima = ambiguity(query, reference, fit.residuals, float(fit.parameters[0]))
    return _variance(fit) + (DISPLACEMENT_ERROR * displacement) ** 2 + other_maxima


def _octave_power(residuals: Array) -> Array:
    """Return the mean power (F,) of residuals (H, W) along the rows in the octave of each frequency."""
    power = (np.abs(np.fft.rfft(residuals, axis=1)) ** 2).mean(axis=0)
    octaves = np.floor(np.log2(np.maximum(np.arange(len(power)), 1))).astype(int)
    power[0] = power[1]  # the means of the rows are subtracted
    return (np.bincount(octaves, power) / np.bincount(octaves))[octaves]


def _mixture_variance(estimates: Sequence[_Estimate], columns: int) -> float:
    """Return the variance, columns squared, about the estimate of the smallest variance.

    Each estimate is right with a probability that is proportional to the inverse of its variance.
    """
    best = min(estimates, key=lambda each: each.variance)
    variances = np.array([each.variance for each in estimates])
    rotations = np.array([each.fit.parameters[0] for each in estimates])
    offsets = periodic(rotations - best.fit.parameters[0], columns)
    weights = 1 / np.maximum(variances, np.finfo(float).tiny)
    return float((weights / weights.sum()) @ (variances + offsets**2))


def wrap_deg(angle: float) -> float:
    """Return an angle within [-180, 180)."""
    return (angle + 180.0) % 360.0 - 180.0


def _refine(query: PanoramaSignature, reference: PanoramaSignature, start: Array) -> _Fit:
    """Minimize the difference of a panorama from a reference by Gauss-Newton, from initial parameters (3,)."""
    fit = _evaluate(query, reference, start)
    for _ in range(MAX_ITERATIONS):
        flat = fit.jacobian.reshape(len(start), -1)
        step = np.linalg.lstsq(flat @ flat.T, flat @ fit.residuals.ravel(), rcond=None)[0]
        for halving in range(MAX_HALVINGS):
            candidate = _evaluate(query, reference, fit.parameters + step / 2**halving)
            if candidate.cost < fit.cost:
                fit = candidate
                break
        else:
            break
        if np.abs(step).max() < STEP_COLUMNS:
            break
    return fit


def _evaluate(query: PanoramaSignature, reference: PanoramaSignature, parameters: Array) -> _Fit:
    """Return the difference of a panorama from a reference at parameters (3,), and its Jacobian."""
    columns = query.values.shape[1]
    azimuth = 2 * np.pi * np.arange(columns) / columns
    basis = np.stack([np.ones(columns), np.sin(azimuth), np.cos(azimuth)])
    positions = (np.arange(columns) + parameters @ basis) % columns
    common = query.observed & reference.observed_at(positions)
    target = normalized(_centered(query.values, common))
    values = _centered(reference.rows(positions).T, common)
    norm = max(float((values**2).sum()), np.finfo(float).tiny)
    gain = (values * target).sum() / norm
    jacobian = gain * _centered(reference.rows(positions, 1).T * basis[:, None], common)
    # The gain is eliminated: only the part of the slopes that is orthogonal to the values changes the residuals.
    jacobian -= (jacobian * values).sum((1, 2), keepdims=True) * values / norm
    return _Fit(parameters, target - gain * values, jacobian)


def _centered(values: Array, common: NDArray[np.bool_]) -> Array:
    """Return values (..., H, W) less the means of their rows over the common columns (W,), and zero elsewhere."""
    means = values @ common / max(int(common.sum()), 1)
    return np.where(common, values - means[..., None], 0.0)


def _variance(fit: _Fit) -> float:
    """Return the variance of the rotation, columns squared, for residuals that are correlated within sectors."""
    count = len(fit.parameters)
    scores = np.einsum("ahw,hw->wa", fit.jacobian, fit.residuals)
    flat = fit.jacobian.reshape(count, -1)
    influence = scores @ np.linalg.pinv(flat @ flat.T)[0]  # of each column on the rotation
    edges = sector_edges(len(influence))
    # Every start of the sectors is equally good.
    totals = [np.add.reduceat(np.roll(influence, k), edges) for k in range(int(np.diff(edges).max(initial=1)))]
    observed = float(np.mean(fit.residuals.any(axis=0)))  # share of the columns
    sectors = max(observed * len(edges), count + 1)
    return float(np.mean(np.square(totals)) * len(edges) * sectors / (sectors - count))
