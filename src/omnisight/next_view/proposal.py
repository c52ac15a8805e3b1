"""Which board, held where, would make a camera surest where it is least sure."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.images import ImageField
from omnisight.next_view.board_placements import BoardPlacements
from omnisight.next_view.information_prior import InformationPrior
from omnisight.next_view.visible_directions import VisibleDirections
from omnisight.targets import Board

Array = NDArray[np.float64]

# Past this error (px of an image 1000 px wide) a direction counts as unknown: a polynomial carried on beyond its
# corners is off by hundreds of px there, which says no more, and would outweigh all that can be mended.
UNKNOWN_PX = 10.0
# Combinations of parameters that boards are compared by.
ESSENTIAL = 24
# A camera as sure as that everywhere (px of an image 1000 px wide) needs no more images.
ENOUGH_PX = 0.2
# Boards that leave a worst error this share above the least are as good: the mean error decides between them.
TIE = 0.05


@dataclass(frozen=True)
class Worst:
    """The direction that a camera is least sure of, among all that its image shows.

    Attributes
    ----------
    error
        Root mean square error there, px.
    pixel
        (2,) where it is seen.
    theta
        Its angle from the axis, radians.
    calibrated
        Whether corners reach that far from the axis.
    mean
        Root mean square of the error over all that the image shows, unknown parts counted with `UNKNOWN_PX`.
    """

    error: float
    pixel: Array
    theta: float
    calibrated: bool
    mean: float


@dataclass(frozen=True)
class NextView:
    """An image to take.

    Attributes
    ----------
    cam_from_board
        Where to hold the board.
    tilt
        Between its normal and the line of sight, radians.
    part
        Of its corners that would be found.
    before, after
        The worst error without the image and with it.
    """

    cam_from_board: Pose
    tilt: float
    part: float
    before: Worst
    after: Worst


@dataclass(frozen=True)
class Proposal:
    """Images to take next, and what they were chosen by.

    Attributes
    ----------
    known, visible
        What the images so far tell, and the directions that count.
    now, inside
        The worst error as things are: over all that the image shows, and over the cone that corners reach.
    views
        The images, in the order to take them.
    """

    known: InformationPrior
    visible: VisibleDirections
    now: Worst
    inside: Worst
    views: tuple[NextView, ...]

    @property
    def enough(self) -> bool:
        """Whether more images hardly help."""
        return self.now.error <= ENOUGH_PX * self.known.camera.px_unit


def unknown_px(known: InformationPrior) -> float:
    """Give the error, px, from which on a direction counts as unknown."""
    return UNKNOWN_PX * known.camera.px_unit


def propose(known: InformationPrior, board: Board, field: ImageField | None = None, count: int = 3) -> Proposal:
    """Choose boards to hold up next, one after another, each the one that lowers the worst error most.

    What a board tells is the information of its projected corners, its pose eliminated; with it the covariance of the
    camera follows, and from that the error of every direction that the image shows (a G-optimal design: Fedorov,
    Theory of optimal experiments, 1972; for calibration Richardson, Strom and Olson, AprilCal, IROS 2013). Errors are
    worst where no corner was seen; those past `UNKNOWN_PX` are all alike unknown, so that a board which makes more of
    the image known goes before one that lowers an absurd number.

    Parameters
    ----------
    known
        The camera, and what the images so far tell.
    board
        What is held up.
    field
        Where the lens shows anything.
    count
        How many.

    Returns
    -------
    Proposal
        With fewer images where no board can be held so that it is found.
    """
    visible = VisibleDirections.of(known, field)
    search = _essentials(known, visible)
    seen, held = VisibleDirections.of(search, field), BoardPlacements.all_over(search, board, field)
    limit = unknown_px(known)
    chosen: list[NextView] = []
    now, inside = worst(known, visible), worst(known, visible, within=known.reach)
    begun, before = known, now
    while len(chosen) < count and len(held.tilt):
        errors = seen.errors_with(search, held.information, np.maximum(held.reach, known.reach))
        clipped = errors * limit / np.hypot(errors, limit)
        largest = clipped.max(1)
        mean = np.where(largest <= (1 + TIE) * largest.min(), clipped**2 @ seen.weight, np.inf)
        best = int(mean.argmin())
        pose = held.rotations[best], held.translations[best]
        known, search = (with_board(k, board, field, *pose) for k in (known, search))
        after = worst(known, visible)
        chosen.append(NextView(Pose(*pose), float(held.tilt[best]), float(held.part[best]), before, after))
        before = after
    return Proposal(begun, visible, now, inside, tuple(chosen))


def _essentials(known: InformationPrior, visible: VisibleDirections) -> InformationPrior:
    """Give what is known in the few combinations of it that move directions most, each with unit variance.

    Most models have no more parameters than that, and nothing is lost. Of a spline's hundreds, the others move nothing
    that is worth an image; what a chosen board brings is told with all of them.
    """
    moved = visible.moved(known, known.reach)
    _, _, vectors = np.linalg.svd(moved.reshape(-1, moved.shape[-1]), full_matrices=False)
    basis = known.half @ vectors[:ESSENTIAL].T
    return replace(known, basis=known.basis @ basis, information=np.eye(basis.shape[1]))


def with_board(
    known: InformationPrior, board: Board, field: ImageField | None, rotation: Array, translation: Array
) -> InformationPrior:
    """Give what would be known with a board held at a pose cam_from_board beside."""
    held = BoardPlacements.of(known, board, field, rotation, translation)
    reach = max(known.reach, float(held.reach[0]))
    return replace(
        known, camera=replace(known.camera, theta_max=reach), information=known.information + held.information[0]
    )


def worst(known: InformationPrior, visible: VisibleDirections, within: float = np.pi) -> Worst:
    """Find where, up to an angle from the axis (radians), a camera is least sure as things are."""
    errors = visible.errors(known, known.reach)
    i = int(np.where(visible.theta <= within * (1 + 1e-9), errors, 0.0).argmax())
    limit = unknown_px(known)
    mean = float(np.sqrt((np.minimum(errors, limit) ** 2) @ visible.weight))
    theta = float(visible.theta[i])
    return Worst(float(errors[i]), visible.pixels[i], theta, theta <= known.reach * (1 + 1e-9), mean)
