"""Which motion and which scene explain pairs of bearings: selection by the geometric information criterion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions, ransac
from omnisight.optim.robust_estimation import THRESHOLDS, RobustEstimate, estimate_robustly
from omnisight.twoview.bearing_pairs import BearingPairs, isotropic_variance
from omnisight.twoview.epipolar import epipolar_residuals, is_behind
from omnisight.twoview.rotation_only import RotationProblem

Array = NDArray[np.float64]

# Dimension of the manifold of pairs, and number of parameters.
MODELS = {"general": (3, 5), "dominant plane": (2, 8), "rotation only": (2, 3)}
# Rms of the components of the parallax over their noise below which the direction of the translation may be wrong by
# more than its covariance states: the cost has several minima. With 300 points at 120 to 600 baselines in a field of
# 60 degrees and a ratio of 1.5 to 2.5, the direction was 5 to 60 degrees off.
MIN_PARALLAX_RATIO = 3.0
# Standard deviation of the direction of the translation, degrees, above which it is unknown.
MAX_DIRECTION_SIGMA_DEG = 10.0
# Quantile 0.999 of a chi-squared variable of three degrees of freedom.
MAX_TRANSLATION_GAIN = 16.27
# Samples of two and four pairs: 500 contain one of inliers only, with 99 % probability, if 10 % of the pairs agree with
# a rotation, and 31 % of the inliers of the relative pose with a plane.
MAX_ITERATIONS = 500
# A motion is planar if its translation is perpendicular to the axis of rotation within so many standard deviations, and
# these are small enough to reveal another one.
PLANAR_SIGMA, MAX_PLANAR_SIGMA_DEG = 2.0, 1.0


@dataclass(frozen=True)
class MotionModel:
    """The model of the motion between two images.

    Attributes
    ----------
    name
        "general"; "planar motion": the translation is perpendicular to the axis of rotation; "dominant plane": most
        points are on one plane; "insufficient parallax": the direction of the translation is unknown or may be wrong;
        "rotation only"; "no overlap".
    figure
        The measured quantity that decided.
    """

    name: str
    figure: str


def select_motion(
    pairs: BearingPairs, general: RobustEstimate[Pose], covariance: Array, options: RansacOptions
) -> tuple[MotionModel, RobustEstimate[Array] | None]:
    """Select the motion model of pairs with known noise; return it and, if it is the best, the rotation.

    The models are compared by the geometric robust information criterion (P. Torr, An assessment of information
    criteria for motion model selection, CVPR 1997).

    Parameters
    ----------
    pairs
        With the noise of the general estimate, if there is one.
    general
        The relative pose, whose state is None if none was found.
    covariance
        (6, 6) covariance of the relative pose.
    options
        Options of the search for a rotation and a plane.
    """
    options = replace(options, max_iterations=MAX_ITERATIONS)
    rotation = estimate_robustly(RotationProblem(pairs), options)
    if general.state is None:
        return _rotation_model(pairs, rotation), rotation
    inliers = pairs[general.inliers]
    squares = {"general": _general_squares(inliers, general.state), "dominant plane": _plane_squares(inliers, options)}
    ratio = np.inf
    if rotation.state is not None:
        chords = RotationProblem(inliers).linearize(rotation.state)[0]
        ratio = np.sqrt(np.nanmean(chords**2))
        if not has_translation(pairs[rotation.inliers], rotation.state):
            squares["rotation only"] = _squares(chords)
    criteria = {name: information_criterion(s, *MODELS[name]) for name, s in squares.items()}
    best = min(criteria, key=criteria.__getitem__)
    if best == "rotation only":
        return _rotation_model(pairs, rotation), rotation
    if ratio < MIN_PARALLAX_RATIO:
        return MotionModel("insufficient parallax", f"rms parallax {ratio:.1f} times its noise"), None
    sigma = largest_sigma_deg(covariance[3:, 3:])
    if not sigma <= MAX_DIRECTION_SIGMA_DEG:
        return MotionModel("insufficient parallax", f"direction of the translation known to {sigma:.1f}° (1σ)"), None
    if best == "dominant plane":
        share = np.mean(squares[best] <= THRESHOLDS[2])
        return MotionModel(best, f"{share:.0%} of the inliers are on one plane"), None
    return _planar_or_general(general.state, covariance), None


def information_criterion(squares: Array, dimension: int, parameters: int) -> float:
    """Return GRIC: sum of min(e^2, 2 (r - d)) + n d log r + k log(r n), for pairs of bearings with r = 4 coordinates.

    Parameters
    ----------
    squares
        (n,) squared residuals over their variances.
    dimension, parameters
        d, the dimension of the manifold of pairs, and k.
    """
    n, r = len(squares), 4
    fit = np.minimum(squares, 2.0 * (r - dimension)).sum()
    return float(fit + n * dimension * np.log(r) + parameters * np.log(r * max(n, 1)))


def has_translation(pairs: BearingPairs, rotation: Array) -> bool:
    """Return whether a translation, with all points at the same distance, significantly improves the fit of a rotation.

    The distances vary, but any common part of the parallax reveals a translation, although the parallax of each pair is
    below its noise. The sum of squared residuals then decreases by more than a chi-squared variable of three degrees of
    freedom exceeds once in a thousand.
    """
    problem = RotationProblem(pairs)
    residuals, by_rotation = problem.linearize(rotation)
    r, j = residuals.reshape(-1), np.concatenate([by_rotation, problem.by_translation(rotation)], axis=2).reshape(-1, 6)
    use = np.isfinite(r)
    alone = np.linalg.lstsq(j[use, :3], r[use], rcond=None)[0]
    both = np.linalg.lstsq(j[use], r[use], rcond=None)[0]
    costs = (((r - j[:, : len(x)] @ x)[use] ** 2).sum() for x in (alone, both))
    return bool(next(costs) - next(costs) > MAX_TRANSLATION_GAIN)


def largest_sigma_deg(covariance: Array) -> float:
    """Return the standard deviation along the most uncertain axis, degrees; NaN if a covariance is not finite."""
    if not np.isfinite(covariance).all():
        return float("nan")
    return float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))


def _general_squares(pairs: BearingPairs, pose: Pose) -> Array:
    squares = epipolar_residuals(pairs, pose)[0] ** 2
    return np.where(is_behind(pairs, pose), np.inf, squares)


def _plane_squares(pairs: BearingPairs, options: RansacOptions) -> Array:
    """Return the squared residuals (N,) of the best homography; inf if there is none."""
    from omnisight.optim._ransac_kernel import squared_errors
    from omnisight.twoview._alignment_problems_kernel import CompiledHomography

    variances = isotropic_variance(pairs.covariance_a), isotropic_variance(pairs.covariance_b)
    problem = CompiledHomography(*map(np.ascontiguousarray, (pairs.a, pairs.b, *variances)))
    order = np.random.default_rng(options.seed).permutation(len(pairs))
    shuffled = CompiledHomography(*(np.ascontiguousarray(rows[order]) for rows in problem))
    found = ransac(shuffled, 4, 1, THRESHOLDS[2], options)
    return np.nan_to_num(squared_errors(problem, found.model), nan=np.inf)


def _squares(residuals: Array) -> Array:
    return np.nan_to_num((residuals**2).sum(axis=1), nan=np.inf)


def _rotation_model(pairs: BearingPairs, rotation: RobustEstimate[Array]) -> MotionModel:
    if rotation.state is None:
        return MotionModel("no overlap", rotation.reason)
    turned = pairs.a[rotation.inliers] @ rotation.state.T
    chord = np.linalg.norm(turned - pairs.b[rotation.inliers], axis=1)
    parallax, noise = np.degrees(np.median(chord)), np.degrees(np.sqrt(np.median(pairs.variance)))
    return MotionModel("rotation only", f"median parallax {parallax:.3f}°, noise {noise:.3f}° (1σ)")


def _planar_or_general(pose: Pose, covariance: Array) -> MotionModel:
    """Return whether the translation is perpendicular to the axis of rotation, with the angle."""
    angle = so3.log(pose.rotation)
    turn = float(np.linalg.norm(angle))
    turn_sigma = float(np.sqrt(np.trace(covariance[:3, :3])))
    if turn <= 3 * turn_sigma:
        return MotionModel("general", f"rotation {np.degrees(turn):.2f}° ± {np.degrees(turn_sigma):.2f}°")
    axis = angle / turn
    sine = float(axis @ pose.translation)
    # An error w of the rotation turns its axis by about w/turn, perpendicular to it.
    gradient = np.concatenate([(pose.translation - sine * axis) / turn, axis])
    sigma = float(np.degrees(np.sqrt(gradient @ covariance @ gradient)))
    out_of_plane = float(np.degrees(np.arcsin(np.clip(sine, -1, 1))))
    figure = f"translation {out_of_plane:.2f}° ± {sigma:.2f}° out of the plane of rotation"
    is_planar = abs(out_of_plane) <= PLANAR_SIGMA * sigma and sigma <= MAX_PLANAR_SIGMA_DEG
    return MotionModel("planar motion" if is_planar else "general", figure)
