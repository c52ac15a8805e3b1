"""Sequential G-optimal design: choose the board placement that minimizes the worst prediction error."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.geometry.pose import Pose
from omnisight.images import ImageField
from omnisight.targets import Board, Detections
from omnisight.view_planning.board_placements import BoardPlacements
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.visible_directions import ANGLE_TOLERANCE, VisibleDirections

Array = NDArray[np.float64]

# Error (px of an image 1000 px wide) above which a direction counts as unknown: extrapolated polynomials have errors of
# hundreds of px, whose size is meaningless and must not dominate the design.
UNKNOWN_ERROR_PX = 10.0
# Worst error (px of an image 1000 px wide) below which more images hardly help: about the noise of a corner.
SUFFICIENT_ERROR_PX = 0.2
# Placements are compared in the subspace of this many combinations of parameters that move directions most.
SUBSPACE_DIMENSION = 24
# Placements whose worst error is within this share of the smallest are ranked by the mean error.
WORST_ERROR_TOLERANCE = 0.05


@dataclass(frozen=True)
class WorstDirection(Displayed):
    """The visible direction with the largest prediction error.

    Attributes
    ----------
    error_px
        Root mean square error there, px.
    pixel
        (2,) its pixel.
    theta
        Its angle off-axis, radians.
    is_calibrated
        Whether it lies within the calibrated field of view.
    rms_px
        Root mean square error over the visible image, px, each error at most the unknown error.
    """

    error_px: float
    pixel: Array
    theta: float
    is_calibrated: bool
    rms_px: float


@dataclass(frozen=True)
class NextView(Displayed):
    """A proposed image.

    Attributes
    ----------
    cam_from_board
        Placement of the board.
    tilt
        Angle between the board's normal and the line of sight, radians.
    visible_fraction
        Share of the corners that would be detected.
    before, after
        The worst direction without and with the image.
    """

    cam_from_board: Pose
    tilt: float
    visible_fraction: float
    before: WorstDirection
    after: WorstDirection


@dataclass(frozen=True)
class Proposal(Displayed):
    """Proposed images and the errors that they are chosen by.

    Attributes
    ----------
    prior
        Information of the images taken so far.
    directions
        The visible directions.
    board
        The board to hold.
    worst, worst_calibrated
        The worst direction now: over the visible image, and within the calibrated field of view.
    views
        The proposed images, in the order to take them; fewer than requested where no placement is detectable.
    """

    prior: InformationPrior
    directions: VisibleDirections
    board: Board
    worst: WorstDirection
    worst_calibrated: WorstDirection
    views: tuple[NextView, ...]

    @property
    def detections(self) -> Detections | None:
        """Per-image results behind the observations; None if they came from arrays."""
        return self.prior.observations.detections

    @property
    def is_sufficient(self) -> bool:
        """Whether more images would hardly help."""
        return self.worst.error_px <= SUFFICIENT_ERROR_PX * self.prior.camera.px_unit


def unknown_error_px(prior: InformationPrior) -> float:
    """Return the error (px) above which a direction counts as unknown."""
    return UNKNOWN_ERROR_PX * prior.camera.px_unit


def propose_views(prior: InformationPrior, board: Board, field: ImageField | None = None, count: int = 3) -> Proposal:
    """Propose board placements one after another, each minimizing the worst prediction error.

    A placement adds the information of its projected corners, the board pose eliminated. The covariance of the camera
    follows, and from it the error of every visible direction (G-optimal design: Fedorov, Theory of optimal experiments,
    1972; for calibration: Richardson, Strom and Olson, AprilCal, IROS 2013). Errors saturate at `UNKNOWN_ERROR_PX`, so
    that the design reduces the unknown part of the image instead of arbitrary extrapolation errors.

    Parameters
    ----------
    prior
        The camera and the information of the images so far.
    board
        The board to hold.
    field
        Image field of the lens or mirror.
    count
        Number of images to propose.
    """
    directions = VisibleDirections.sample(prior, field)
    reduced = _dominant_subspace(prior, directions)
    reduced_directions = VisibleDirections.sample(reduced, field)
    placements = BoardPlacements.sample(reduced, board, field)
    worst, worst_calibrated = worst_direction(prior, directions), worst_direction(prior, directions, prior.theta_max)
    views: list[NextView] = []
    current, before = prior, worst
    while len(views) < count and len(placements.tilt):
        best = _best_placement(reduced, reduced_directions, placements, current.theta_max)
        pose = placements.rotations[best], placements.translations[best]
        current, reduced = (add_placement(p, board, field, *pose) for p in (current, reduced))
        after = worst_direction(current, directions)
        tilt, fraction = float(placements.tilt[best]), float(placements.visible_fraction[best])
        views.append(NextView(Pose(*pose), tilt, fraction, before, after))
        before = after
    return Proposal(prior, directions, board, worst, worst_calibrated, tuple(views))


def add_placement(
    prior: InformationPrior, board: Board, field: ImageField | None, rotation: Array, translation: Array
) -> InformationPrior:
    """Return the prior with the information of one more board placement cam_from_board."""
    placement = BoardPlacements.single(prior, board, field, rotation, translation)
    theta_max = max(prior.theta_max, float(placement.theta_max[0]))
    information = prior.information + placement.information[0]
    return replace(prior, camera=replace(prior.camera, theta_max=theta_max), information=information)


def worst_direction(prior: InformationPrior, directions: VisibleDirections, theta_max: float = np.pi) -> WorstDirection:
    """Find the direction with the largest error up to an angle off-axis (radians)."""
    errors = directions.errors(prior, prior.theta_max)
    within = directions.theta <= theta_max * (1 + ANGLE_TOLERANCE)
    i = int(np.where(within, errors, 0.0).argmax())
    rms = float(np.sqrt(np.minimum(errors, unknown_error_px(prior)) ** 2 @ directions.weight))
    theta = float(directions.theta[i])
    is_calibrated = theta <= prior.theta_max * (1 + ANGLE_TOLERANCE)
    return WorstDirection(float(errors[i]), directions.pixels[i], theta, is_calibrated, rms)


def _best_placement(
    prior: InformationPrior, directions: VisibleDirections, placements: BoardPlacements, theta_max: float
) -> int:
    """Return the index of the placement with the smallest worst error; the mean error decides between near ties."""
    errors = directions.errors_with_added(prior, placements.information, np.maximum(placements.theta_max, theta_max))
    limit = unknown_error_px(prior)
    saturated = errors * limit / np.hypot(errors, limit)
    worst = saturated.max(1)
    is_tied = worst <= (1 + WORST_ERROR_TOLERANCE) * worst.min()
    return int(np.where(is_tied, saturated**2 @ directions.weight, np.inf).argmin())


def _dominant_subspace(prior: InformationPrior, directions: VisibleDirections) -> InformationPrior:
    """Restrict the prior to the combinations of parameters that move directions most, each with unit variance.

    Most models have no more parameters than that, so nothing is lost. Of the hundreds of parameters of a spline, the
    others move no direction noticeably; the errors after a choice are computed with all of them.
    """
    displacements = directions.displacements(prior, prior.theta_max)
    _, _, vectors = np.linalg.svd(displacements.reshape(-1, displacements.shape[-1]), full_matrices=False)
    basis = prior.covariance_root @ vectors[:SUBSPACE_DIMENSION].T
    return replace(prior, basis=prior.basis @ basis, information=np.eye(basis.shape[1]))
