"""Boards that could be held in front of the camera, and what their corners would tell."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import ImageField
from omnisight.next_view.information_prior import InformationPrior
from omnisight.next_view.visible_directions import places_in, visible_reach
from omnisight.targets import Board
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]

# Where the board's middle is seen: how far out, as shares of the largest radius, and places around.
OUT, SECTORS = np.array([0.12, 0.3, 0.45, 0.6, 0.75, 0.9]), 12
# Shares of what the camera sees that the board's longer side spans. A lens may see more than this angle, but a
#  board that spans so much of that would touch its glass.
FILLED = (1 / 3, 1 / 2, 2 / 3)
WIDEST = np.radians(100)
TILTS = (0.0, np.radians(30), np.radians(45))
# The board leans about its own x or y axis, to either side.
SIDES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
# A corner is found where its squares are that large (px), seen no more aslant, and that far from every border (px).
LEAST_SQUARE, SLANT, MARGIN = 6.0, np.radians(75), 4.0
# Part of the corners that must be found, and how many.
LEAST_PART, LEAST_CORNERS = 1 / 3, 12
# Of a board with more corners every second or third is computed, and counts for the others.
ENOUGH = 100
BATCH = 200


@dataclass(frozen=True)
class BoardPlacements:
    """Boards in front of a camera.

    Attributes
    ----------
    rotations, translations
        cam_from_board (K, 3, 3) and (K, 3).
    tilt
        (K,) angle between the board's normal and the line of sight to its middle, radians.
    part
        (K,) of the corners that are found.
    information
        (K, F, F) what they tell of what is known, their pose unknown.
    reach
        (K,) the largest angle from the axis (radians) of a corner.
    """

    rotations: Array
    translations: Array
    tilt: Array
    part: Array
    information: Array
    reach: Array

    @classmethod
    def all_over(cls, known: InformationPrior, board: Board, field: ImageField | None) -> Self:
        """Hold a board everywhere in the field of view, near and far, upright in the image, tilted to its four sides.

        Only those of which enough corners are found are kept; `field` is where the lens shows anything.
        """
        last = visible_reach(known, field)
        towards, _ = places_in(known, field, OUT, SECTORS)
        theta, phi = angle_from_axis(towards), np.arctan2(towards[:, 1], towards[:, 0])
        # The shortest turn from the axis keeps the board as upright as it is seen there.
        turns = so3.exp(theta[:, None] * np.stack([-np.sin(phi), np.cos(phi), 0 * phi], -1))
        leans = np.array([(0.0, 0.0, 0.0), *((t * x, t * y, 0.0) for t in TILTS[1:] for x, y in SIDES)])
        size = float(np.ptp(board.points, axis=0).max())
        distances = size / 2 / np.tan(np.array(FILLED) * min(2 * last, WIDEST) / 2)
        place, near, lean = np.indices((len(theta), len(distances), len(leans))).reshape(3, -1)
        rotations = turns[place] @ so3.exp(leans)[lean]
        middles = towards[place] * distances[near][:, None]
        translations = middles - rotations @ board.points.mean(0)
        tilt = np.linalg.norm(leans, axis=1)[lean]
        stride = -(-board.size // ENOUGH)
        which = np.arange(stride // 2, board.size, stride)
        parts = [
            cls._measured(known, board, field, which, rotations[rows], translations[rows], tilt[rows])
            for rows in np.array_split(np.arange(len(tilt)), -(-len(tilt) // BATCH))
        ]
        held = cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))
        return held.only(held.part >= max(LEAST_PART, LEAST_CORNERS / board.size))

    def only(self, which: NDArray[np.bool_]) -> Self:
        """Give some of them."""
        return type(self)(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def of(
        cls, known: InformationPrior, board: Board, field: ImageField | None, rotation: Array, translation: Array
    ) -> Self:
        """Hold a board at a single pose cam_from_board, all its corners counted."""
        middle = rotation @ board.points.mean(0) + translation
        tilt = np.arccos(np.clip(rotation[:, 2] @ middle / np.linalg.norm(middle), -1, 1))
        pose = rotation[None], translation[None], np.array([tilt])
        return cls._measured(known, board, field, np.arange(board.size), *pose)

    @classmethod
    def _measured(
        cls,
        known: InformationPrior,
        board: Board,
        field: ImageField | None,
        which: NDArray[np.intp],
        rotations: Array,
        translations: Array,
        tilt: Array,
    ) -> Self:
        count, points = len(rotations), board.points[which]
        bows = Observations.of([(points, np.zeros((len(points), 2)))], extent=known.views.extent).bows
        bent = points + (bows @ known.state.warp)[:, None] * (0.0, 0.0, 1.0)
        turned = bent @ np.swapaxes(rotations, 1, 2)
        seen = (turned + translations[:, None]).reshape(-1, 3)
        pixels, valid, d_point, d_params = known.camera.model.project_with_jacobians(seen)
        turned = turned.reshape(-1, 3)
        axes = np.repeat(rotations, len(points), 0)
        found = valid & _found(known, board, field, seen, pixels, d_point, axes)
        d_point, d_params = np.where(found[:, None, None], d_point, 0.0), np.where(found[:, None, None], d_params, 0.0)
        # As in a bundle: x_c = exp(w) R x + t + v.
        d_pose = np.concatenate([np.cross(turned[:, None, :], d_point), d_point], -1)
        d_shared = d_params @ known.freedom.directions
        if known.freedom.warp:
            back = np.einsum("nri,ni->nr", d_point, axes[:, :, 2])
            d_shared = np.concatenate([d_shared, back[..., None] * np.tile(bows, (count, 1))[:, None, :]], -1)
        j = (d_shared @ known.basis).reshape(count, -1, known.basis.shape[1])
        # An orthonormal basis of what the pose takes up: A - B C^-1 B^T without C, as in `information`.
        q, _ = np.linalg.qr(d_pose.reshape(count, -1, 6))
        j = j - q @ (np.swapaxes(q, 1, 2) @ j)
        information = np.swapaxes(j, 1, 2) @ j * (board.size / len(points) / known.variance)
        each = found.reshape(count, -1)
        reach = np.where(each, angle_from_axis(seen).reshape(count, -1), 0.0).max(1)
        return cls(rotations, translations, tilt, each.mean(1), information, reach)


def spacing_of(board: Board) -> float:
    """Give the distance from the board's first point to the nearest other one: a square of a checkerboard."""
    points = board.points
    return float(np.linalg.norm(points[1:] - points[0], axis=1).min())


def _found(
    known: InformationPrior,
    board: Board,
    field: ImageField | None,
    seen: Array,
    pixels: Array,
    d_point: Array,
    axes: Array,
) -> NDArray[np.bool_]:
    """Say at which corners (N,) a detector would find one."""
    shown = ((pixels >= MARGIN - 0.5) & (pixels <= np.array(known.camera.size) - 0.5 - MARGIN)).all(1)
    if field is not None:
        shown &= field.contains(pixels, MARGIN)
    facing = np.einsum("ni,ni->n", axes[:, :, 2], seen) >= np.cos(SLANT) * np.linalg.norm(seen, axis=1)
    # The lesser side of a square in the image: the smaller singular value of d pixel/d (x, y) on the board.
    across, down = np.moveaxis(d_point @ axes[:, :, :2] * spacing_of(board), 2, 0)
    area = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    longer = np.maximum(np.linalg.norm(across, axis=1), np.linalg.norm(down, axis=1))
    with np.errstate(invalid="ignore"):
        return shown & facing & (area >= LEAST_SQUARE * longer) & np.isfinite(d_point).all((1, 2))
