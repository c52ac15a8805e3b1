"""Candidate designs: board placements in front of the camera, with the information that each would add."""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import ImageField
from omnisight.targets import Board
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.visible_directions import sample_image, visible_theta_max

Array = NDArray[np.float64]

# Image positions of the board's centre: radii as shares of the largest, and positions per ring.
RADII, SECTORS = np.array([0.12, 0.3, 0.45, 0.6, 0.75, 0.9]), 12
# Angles that the longer side of the board subtends, as shares of the field of view; of a wider field of view than
# MAX_SPAN_RAD, a board at that distance would touch the lens.
SPANS, MAX_SPAN_RAD = (1 / 3, 1 / 2, 2 / 3), np.radians(100)
# Tilts of the board about its x and y axes, to either side.
TILTS_RAD, TILT_AXES = (np.radians(30), np.radians(45)), ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
# Corners are detectable if their squares are that large, seen at most so obliquely, and that far from every border.
MIN_SQUARE_PX, MAX_OBLIQUITY_RAD, BORDER_MARGIN_PX = 6.0, np.radians(75), 4.0
# A placement needs this share of the corners, and this number, to be detectable.
MIN_VISIBLE_FRACTION, MIN_CORNERS = 1 / 3, 12
# Boards with more corners are subsampled, and the information is scaled accordingly.
MAX_EVALUATED_CORNERS = 100
# Placements evaluated at a time, which bounds the memory.
BATCH_SIZE = 200


@dataclass(frozen=True)
class BoardPlacements:
    """Boards in front of a camera.

    Attributes
    ----------
    rotations, translations
        cam_from_board, (K, 3, 3) and (K, 3).
    tilt
        (K,) angle between the board's normal and the line of sight to its centre, radians.
    visible_fraction
        (K,) share of the corners that are detectable.
    information
        (K, F, F) information about the coordinates of the prior, the board pose eliminated.
    theta_max
        (K,) largest angle off-axis (radians) of a corner.
    """

    rotations: Array
    translations: Array
    tilt: Array
    visible_fraction: Array
    information: Array
    theta_max: Array

    @classmethod
    def sample(cls, prior: InformationPrior, board: Board, field: ImageField | None) -> Self:
        """Sample placements over the field of view, upright in the image, at several distances and tilts.

        Only placements with enough detectable corners are kept.
        """
        bearings, _ = sample_image(prior, field, RADII, SECTORS)
        theta, phi = angle_from_axis(bearings), np.arctan2(bearings[:, 1], bearings[:, 0])
        # The shortest rotation from the optical axis keeps the board upright in the image.
        towards = so3.exp(theta[:, None] * np.stack([-np.sin(phi), np.cos(phi), 0 * phi], -1))
        tilts = np.array([(0.0, 0.0, 0.0), *((t * x, t * y, 0.0) for t in TILTS_RAD for x, y in TILT_AXES)])
        field_of_view = min(2 * visible_theta_max(prior, field), MAX_SPAN_RAD)
        distances = float(np.ptp(board.points, axis=0).max()) / 2 / np.tan(np.array(SPANS) * field_of_view / 2)
        i, j, k = np.indices((len(theta), len(distances), len(tilts))).reshape(3, -1)
        rotations = towards[i] @ so3.exp(tilts)[k]
        translations = bearings[i] * distances[j][:, None] - rotations @ board.points.mean(0)
        tilt = np.linalg.norm(tilts, axis=1)[k]
        stride = -(-board.size // MAX_EVALUATED_CORNERS)
        corners = np.arange(stride // 2, board.size, stride)
        batches = [
            cls._evaluate(prior, board, field, corners, (rotations[rows], translations[rows]), tilt[rows])
            for rows in np.array_split(np.arange(len(tilt)), -(-len(tilt) // BATCH_SIZE))
        ]
        placements = cls(*(np.concatenate([getattr(batch, f.name) for batch in batches]) for f in fields(cls)))
        return placements.subset(placements.visible_fraction >= max(MIN_VISIBLE_FRACTION, MIN_CORNERS / board.size))

    @classmethod
    def single(
        cls, prior: InformationPrior, board: Board, field: ImageField | None, rotation: Array, translation: Array
    ) -> Self:
        """Evaluate one placement cam_from_board with all corners of the board."""
        centre = rotation @ board.points.mean(0) + translation
        tilt = np.arccos(np.clip(rotation[:, 2] @ centre / np.linalg.norm(centre), -1, 1))
        poses = rotation[None], translation[None]
        return cls._evaluate(prior, board, field, np.arange(board.size), poses, np.array([tilt]))

    def subset(self, which: NDArray[np.bool_]) -> Self:
        """Return the placements selected by a mask (K,)."""
        return type(self)(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def _evaluate(
        cls,
        prior: InformationPrior,
        board: Board,
        field: ImageField | None,
        corners: NDArray[np.intp],
        poses: tuple[Array, Array],
        tilt: Array,
    ) -> Self:
        """Compute detectability and information of placements from some of the corners."""
        (rotations, translations), points = poses, board.points[corners]
        count = len(rotations)
        warp_basis = replace(prior.observations, points=points).warp_basis
        warped = points + (warp_basis @ prior.state.warp)[:, None] * (0.0, 0.0, 1.0)
        rotated = warped @ np.swapaxes(rotations, 1, 2)
        in_camera = (rotated + translations[:, None]).reshape(-1, 3)
        pixels, valid, d_point, d_params = prior.camera.model.project_with_jacobians(in_camera)
        axes = np.repeat(rotations, len(points), 0)
        cosine = np.einsum("ni,ni->n", axes[:, :, 2], in_camera) / np.linalg.norm(in_camera, axis=1)
        sides = d_point @ axes[:, :, :2] * point_spacing(board)
        detected = valid & _is_detectable(prior, field, pixels, cosine, sides)
        d_point = np.where(detected[:, None, None], d_point, 0.0)
        d_params = np.where(detected[:, None, None], d_params, 0.0)
        # Pose increments as in the bundle adjustment: x_c = exp(w) R x + t + v.
        d_pose = np.concatenate([np.cross(rotated.reshape(-1, 1, 3), d_point), d_point], -1)
        d_shared = d_params @ prior.free_parameters.directions
        if prior.free_parameters.warp:
            d_z = np.einsum("nri,ni->nr", d_point, axes[:, :, 2])
            d_warp = d_z[..., None] * np.tile(warp_basis, (count, 1))[:, None, :]
            d_shared = np.concatenate([d_shared, d_warp], -1)
        jacobian = (d_shared @ prior.basis).reshape(count, -1, prior.basis.shape[1])
        # Projecting out the pose Jacobian gives the Schur complement without forming its inverse.
        q, _ = np.linalg.qr(d_pose.reshape(count, -1, 6))
        jacobian = jacobian - q @ (np.swapaxes(q, 1, 2) @ jacobian)
        scale = board.size / len(points) / prior.noise_variance
        information = np.swapaxes(jacobian, 1, 2) @ jacobian * scale
        detected = detected.reshape(count, -1)
        theta_max = np.where(detected, angle_from_axis(in_camera).reshape(count, -1), 0.0).max(1)
        return cls(rotations, translations, tilt, detected.mean(1), information, theta_max)


def point_spacing(board: Board) -> float:
    """Return the distance from the board's first point to its nearest neighbour: a square of a checkerboard."""
    points = board.points
    return float(np.linalg.norm(points[1:] - points[0], axis=1).min())


def _is_detectable(
    prior: InformationPrior, field: ImageField | None, pixels: Array, cosine: Array, sides: Array
) -> NDArray[np.bool_]:
    """Return which corners (N,) a detector would find.

    Parameters
    ----------
    pixels
        (N, 2) in the image.
    cosine
        (N,) of the angle between the normal of the board and the line of sight.
    sides
        (N, 2, 2) the sides of a square in the image, px: columns.
    """
    low, high = BORDER_MARGIN_PX - 0.5, np.array(prior.camera.size) - 0.5 - BORDER_MARGIN_PX
    is_inside = ((pixels >= low) & (pixels <= high)).all(1)
    if field is not None:
        is_inside &= field.contains(pixels, BORDER_MARGIN_PX)
    is_facing = cosine >= np.cos(MAX_OBLIQUITY_RAD)
    # The shorter side of a square in the image is about its area divided by its longer side.
    side_x, side_y = np.moveaxis(sides, 2, 0)
    area = np.abs(side_x[:, 0] * side_y[:, 1] - side_x[:, 1] * side_y[:, 0])
    longer = np.maximum(np.linalg.norm(side_x, axis=1), np.linalg.norm(side_y, axis=1))
    with np.errstate(invalid="ignore"):
        return is_inside & is_facing & (area >= MIN_SQUARE_PX * longer) & np.isfinite(sides).all((1, 2))
