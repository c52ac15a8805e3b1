"""Which motion and which scene explain pairs of bearings."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry import rotation as so3
from omnisight.optim.ransac import RansacOptions, ransac
from omnisight.optim.refinement import THRESHOLDS
from omnisight.optim.robust_estimation import MAX_CHANCE_GAIN, RobustEstimate, estimate_robustly
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]

# Dimension of the manifold of pairs, and number of parameters, of a general motion and of the homography of a plane.
GENERAL, PLANE = (3, 5), (2, 8)
# Rms of the components of the parallax over their noise below which the direction of the translation may be wrong by
# more than its covariance states: the cost has several minima. With 300 points at 120 to 600 baselines in a field of
# 60 degrees and a ratio of 1.5 to 2.5, the direction was 5 to 60 degrees off.
MIN_PARALLAX_RATIO = 3.0
# Pairs with a larger parallax are not counted for it: a tenth may be wrong matches that agree with a pose by chance.
MAX_CHANCE_QUANTILE = 0.9
# Standard deviation of the direction of the translation, degrees, above which it is unknown.
MAX_DIRECTION_SIGMA_DEG = 10.0
# Quantile 0.999 of a chi-squared variable of three degrees of freedom.
MAX_TRANSLATION_GAIN = 16.27
# Samples of two pairs: 500 contain one of inliers only, with 99 % probability, if 10 % of the pairs agree with a
# rotation.
MAX_ITERATIONS = 500
# A plane has a lower criterion than the general motion, or a rotation leaves a parallax near its noise, only if about
# three quarters of the inliers agree with it. At least one of 30 samples of four pairs then consists of such inliers,
# with a probability of 1 - 1e-5.
MAX_COMPETING_ITERATIONS = 30
# A motion is planar if its translation is perpendicular to the axis of rotation within so many standard deviations, and
# these are small enough to reveal another one.
PLANAR_SIGMA, MAX_PLANAR_SIGMA_DEG = 2.0, 1.0


@dataclass(frozen=True)
class MotionModel(Displayed):
    """The model of the motion between two images.

    Attributes
    ----------
    name
        "general"; "planar motion": the translation is perpendicular to the axis of rotation; "dominant plane": most
        points are on one plane; "insufficient parallax": the direction of the translation is unknown or may be wrong;
        "rotation only"; "ambiguous": a second pose has nearly as much support or is nearly as probable;
        "no overlap".
    figure
        The measured quantity that decided.
    """

    name: str
    figure: str


@dataclass(frozen=True, eq=False)
class MotionSelection:
    """The motion model, with the rotation or the homography (3, 4) if it is the best.

    With insufficient parallax, a homography determines the pose more precisely than an epipolar geometry if it explains
    the pairs as well: it is then that of a plane, or of distant points.

    The covariance of the pose decides what a general motion is, see `pose_motion`.
    """

    motion: MotionModel
    rotation: RobustEstimate | None = None
    homography: Array | None = None


def select_motion(
    pairs: BearingPairs, inliers: BearingPairs, general: RobustEstimate, options: RansacOptions
) -> MotionSelection:
    """Select the motion model of pairs with known noise.

    The motion is a rotation only if the parallax is near its noise, contains no significant translation, and a plane
    does not explain significantly more pairs: the noise that was estimated with the general motion, which fits some of
    it, is too low for a comparison of both. In a narrow field of view, a translation along a plane is nearly a
    rotation. A plane and a general motion are compared by the geometric robust information criterion (P. Torr, An
    assessment of information criteria for motion model selection, CVPR 1997).

    Parameters
    ----------
    pairs
        With the noise of the general estimate, if there is one.
    inliers
        Those of the general estimate, in random order.
    general
        The relative pose, whose model is None if none was found.
    options
        Options of the search for a rotation and a plane.
    """
    from omnisight.optim._robust_problem_kernel import squared_residuals
    from omnisight.twoview._alignment_problems_kernel import HomographyProblem, RotationProblem
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    if general.has_alternative_model:
        return MotionSelection(MotionModel("ambiguous", general.reason))
    if general.model is None:
        return _rotation_model(pairs, options)
    search = replace(options, max_iterations=MAX_COMPETING_ITERATIONS)
    _, parallax = _best(RotationProblem.of(inliers), search)
    homography, squares_of_plane = _best(HomographyProblem.of(inliers), search)
    ratio = float(np.sqrt(np.sort(parallax)[: int(np.ceil(MAX_CHANCE_QUANTILE * len(inliers)))].mean()))
    if ratio < MIN_PARALLAX_RATIO and not _have_more_support(squares_of_plane, parallax):
        found = _rotation_model(pairs, options)
        rotation = found.rotation
        if rotation and rotation.model is not None and not has_translation(pairs[rotation.inliers], rotation.model):
            return found
    squares = squared_residuals(RelativePoseProblem.of(inliers), general.model)
    is_plane = information_criterion(squares_of_plane, *PLANE) < information_criterion(squares, *GENERAL)
    name, figure = "general", f"rms parallax {ratio:.1f} times its noise"
    if ratio < MIN_PARALLAX_RATIO:
        name = "insufficient parallax"
    elif is_plane:
        share = np.mean(squares_of_plane <= THRESHOLDS[2])
        name, figure = "dominant plane", f"{share:.0%} of the inliers are on one plane"
    return MotionSelection(MotionModel(name, figure), homography=homography if is_plane else None)


def pose_motion(model: Array, covariance: Array) -> MotionModel:
    """Return whether a pose (3, 4) with a covariance (6, 6) is a planar or a general motion or has no direction."""
    return unknown_direction(covariance) or _planar_or_general(model, covariance)


def unknown_direction(covariance: Array) -> MotionModel | None:
    """Return insufficient parallax if a covariance (6, 6) leaves the direction of the translation unknown."""
    sigma = largest_sigma_deg(covariance[3:, 3:])
    if sigma <= MAX_DIRECTION_SIGMA_DEG:
        return None
    return MotionModel("insufficient parallax", f"direction of the translation known to {sigma:.1f}° (1σ)")


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


def has_translation(pairs: BearingPairs, model: Array) -> bool:
    """Return whether a translation, with all points at the same distance, significantly improves the fit of a rotation.

    The distances vary, but any common part of the parallax reveals a translation, although the parallax of each pair is
    below its noise. The sum of squared residuals then decreases by more than a chi-squared variable of three degrees of
    freedom exceeds once in a thousand.
    """
    from omnisight.optim._robust_problem_kernel import linearized
    from omnisight.twoview._absolute_pose_kernel import AbsolutePoseProblem

    rotation = model[:, :3]
    covariance = pairs.covariance_b + rotation @ pairs.covariance_a @ rotation.T
    problem = AbsolutePoseProblem(*map(np.ascontiguousarray, (pairs.a, pairs.b, covariance, pairs.variance)))
    residuals, jacobians = linearized(problem, model)
    r, j = residuals.reshape(-1), jacobians.reshape(-1, 6)
    use = np.isfinite(r)
    alone, both = (_least_cost(j[use, :columns], r[use]) for columns in (3, 6))
    variance = max(both / max(use.sum() - 6, 1), 1.0)  # above 1 if the noise was that of another motion
    return alone - both > MAX_TRANSLATION_GAIN * variance


def _least_cost(jacobian: Array, residuals: Array) -> float:
    """Return the least sum of squares of linear residuals."""
    step = np.linalg.lstsq(jacobian, residuals, rcond=None)[0]
    return float(((residuals - jacobian @ step) ** 2).sum())


def largest_sigma_deg(covariance: Array) -> float:
    """Return the standard deviation along the most uncertain axis, at most 180 degrees; NaN if it is not finite."""
    if not np.isfinite(covariance).all():
        return float("nan")
    return min(float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))), 180.0)


def _best(problem: Any, options: RansacOptions) -> tuple[Array, Array]:
    """Return the model of least truncated cost of observations in random order, and their squared residuals (N,)."""
    from omnisight.optim._robust_problem_kernel import squared_residuals

    found = ransac(problem, THRESHOLDS[2], options)
    return found.model, squared_residuals(problem, found.model)


def _have_more_support(squares: Array, others: Array) -> bool:
    """Return whether significantly more pairs agree with a model than with another one, given squared residuals (N,).

    Only the pairs that agree with one of them count (Q. McNemar, Note on the sampling error of the difference between
    correlated proportions or percentages, Psychometrika 1947).
    """
    agree, others_agree = squares <= THRESHOLDS[2], others <= THRESHOLDS[2]
    more, less = int((agree & ~others_agree).sum()), int((others_agree & ~agree).sum())
    return more - less > MAX_CHANCE_GAIN * np.sqrt(more + less)


def _rotation_model(pairs: BearingPairs, options: RansacOptions) -> MotionSelection:
    """Return the rotation that explains the pairs best, and its motion model: "no overlap" if there is none."""
    from omnisight.twoview._alignment_problems_kernel import RotationProblem

    rotation = estimate_robustly(
        lambda scale: RotationProblem.of(pairs.scaled(scale)),
        is_scale_known=pairs.is_noise_known,
        options=replace(options, max_iterations=MAX_ITERATIONS),
    )
    if rotation.model is None:
        return MotionSelection(MotionModel("no overlap", rotation.reason), rotation)
    turned = pairs.a[rotation.inliers] @ rotation.model[:, :3].T
    chord = np.linalg.norm(turned - pairs.b[rotation.inliers], axis=1)
    parallax, noise = np.degrees(np.median(chord)), rotation.scale * np.degrees(np.sqrt(np.median(pairs.variance)))
    motion = MotionModel("rotation only", f"median parallax {parallax:.3f}°, noise {noise:.3f}° (1σ)")
    return MotionSelection(motion, rotation)


def _planar_or_general(model: Array, covariance: Array) -> MotionModel:
    """Return whether the translation is perpendicular to the axis of rotation, with the angle."""
    angle = so3.log(model[:, :3])
    turn = float(np.linalg.norm(angle))
    turn_sigma = float(np.sqrt(np.trace(covariance[:3, :3])))
    if turn <= 3 * turn_sigma:
        return MotionModel("general", f"rotation {np.degrees(turn):.2f}° ± {np.degrees(turn_sigma):.2f}°")
    axis = angle / turn
    sine = float(axis @ model[:, 3])
    # An error w of the rotation turns its axis by about w/turn, perpendicular to it.
    gradient = np.concatenate([(model[:, 3] - sine * axis) / turn, axis])
    sigma = float(np.degrees(np.sqrt(gradient @ covariance @ gradient)))
    out_of_plane = float(np.degrees(np.arcsin(np.clip(sine, -1, 1))))
    figure = f"translation {out_of_plane:.2f}° ± {sigma:.2f}° out of the plane of rotation"
    is_planar = abs(out_of_plane) <= PLANAR_SIGMA * sigma and sigma <= MAX_PLANAR_SIGMA_DEG
    return MotionModel("planar motion" if is_planar else "general", figure)
