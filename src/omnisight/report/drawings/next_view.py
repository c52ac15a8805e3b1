"""Drawing of the proposed board placements over an image, with the projection uncertainty in color."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import angle_from_axis, polar
from omnisight.images import read_image, write_image
from omnisight.report.drawings.canvas import Color, ImageCanvas, blank_image
from omnisight.report.drawings.next_view_panel import (
    DOT_COLOR,
    UNCERTAINTY_OPACITY,
    VIEW_COLORS,
    draw_panel,
    draw_view_number,
    panel_height,
    uncertainty_color,
    uncertainty_level,
)
from omnisight.targets import Detections
from omnisight.view_planning.board_placements import point_spacing
from omnisight.view_planning.description import FACING_RAD, nearer_edge
from omnisight.view_planning.proposal import NextView, Proposal

Array = NDArray[np.float64]

# Longer side of the drawn image, px.
IMAGE_SIZE_PX = 1500
BRIGHTNESS = 0.55
# Background level if no image file is available.
BLANK_LEVEL = np.uint8(150)
BOUNDARY_COLOR, DARK_SQUARE, LIGHT_SQUARE = (150, 190, 255), (25, 25, 25), (240, 240, 240)
# Opacity of the first board, of later boards, and of boards outside the image field.
FIRST_OPACITY, LATER_OPACITY, HIDDEN_OPACITY = 0.9, 0.4, 0.15
# Farther projections overflow the fixed-point coordinates of OpenCV.
MAX_PIXEL = 1e5
# Spacing of the hatching, and of the pixels at which the uncertainty is evaluated, px of the drawing.
HATCH_PX, UNCERTAINTY_STEP_PX = 22, 8
BOARD_LINE_WIDTH, NEAR_EDGE_WIDTH, BOUNDARY_WIDTH = 4, 14, 2
# Points along the boundary of the visible directions, along an edge of the board, and along the side of a square.
BOUNDARY_POINTS, EDGE_POINTS, SQUARE_POINTS = 240, 60, 8


def draw_proposal(proposal: Proposal, detections: Detections, file: Path, *, apply_exif: bool = False) -> None:
    """Draw the proposed boards over an image, with the projection uncertainty in color and a panel of instructions.

    If only the corners were given and no image file exists, a blank image with the visible field is used.
    """
    paths = [image.path for image in detections.found if image.path.is_file()]
    image = read_image(paths[0], apply_exif=apply_exif) if paths else blank_image(detections.size, BLANK_LEVEL)
    canvas = ImageCanvas(image, IMAGE_SIZE_PX / max(image.shape[:2]), gray=True, brightness=BRIGHTNESS)
    canvas.line_width = BOUNDARY_WIDTH
    visible = draw_uncertainty(canvas, proposal, detections)
    if not paths:
        canvas.polyline(_visible_boundary(proposal), BOUNDARY_COLOR)
    canvas.field(detections.field, BOUNDARY_COLOR)
    canvas.dots(proposal.prior.observations.pixels, DOT_COLOR)
    for i, view in reversed(list(enumerate(proposal.views))):
        BoardDrawing(canvas, proposal, view, i).draw(visible)
    _draw_numbers(canvas, proposal)
    height = max(len(canvas.pixels), panel_height(proposal))
    padded = np.pad(canvas.pixels, ((0, height - len(canvas.pixels)), (0, 0), (0, 0)))
    write_image(file, np.concatenate([padded, draw_panel(proposal, height)], 1))


def draw_uncertainty(canvas: ImageCanvas, proposal: Proposal, detections: Detections) -> NDArray[np.bool_]:
    """Color the image by projection uncertainty, hatch the extrapolated part, and return the mask of the field."""
    import cv2

    prior = proposal.prior
    camera = prior.camera
    height, width = canvas.pixels.shape[:2]
    step = UNCERTAINTY_STEP_PX
    v, u = np.mgrid[0 : height + step : step, 0 : width + step : step]
    pixels = np.stack([u.ravel(), v.ravel()], -1) / canvas.zoom
    bearings, valid = camera.model.unproject_numpy(pixels)
    # Pixels outside the domain of the model are unknown.
    level, theta = np.ones(len(pixels)), np.full(len(pixels), np.pi)
    level[valid] = uncertainty_level(prior, proposal.directions.errors_at(prior, bearings[valid]))
    theta[valid] = angle_from_axis(bearings[valid])

    def upsample(values: Array) -> Any:
        size = (width + step, height + step)
        large = cv2.resize(values.reshape(u.shape).astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
        return large[step // 2 : height + step // 2, step // 2 : width + step // 2]

    color = uncertainty_color(upsample(level))
    row, column = np.mgrid[:height, :width]
    positions = np.stack([column, row], -1) / canvas.zoom
    visible = camera.in_image(positions) if detections.field is None else detections.field.contains(positions)
    hatched = visible & (upsample(theta) > prior.theta_max) & ((row + column) % HATCH_PX < 2)
    mixed = (1 - UNCERTAINTY_OPACITY) * canvas.pixels + UNCERTAINTY_OPACITY * color
    canvas.pixels[visible] = mixed[visible].astype(np.uint8)
    canvas.pixels[hatched] = (0.6 * canvas.pixels[hatched] + 0.4 * 235).astype(np.uint8)
    return visible


class BoardDrawing:
    """A proposed board as the camera would see it."""

    def __init__(self, canvas: ImageCanvas, proposal: Proposal, view: NextView, number: int) -> None:
        self.canvas, self.proposal, self.view, self.number = canvas, proposal, view, number

    def draw(self, visible: NDArray[np.bool_]) -> None:
        """Draw the squares and the outline, with the edge nearer to the camera as a thick line.

        The first board is more opaque than later ones, and less opaque where the image field ends.
        """
        import cv2

        low, high, side = self._extent()
        counts = np.rint((high - low) / side).astype(int)
        overlay = self.canvas.pixels.copy()
        for i, j in product(range(-1, counts[0] + 1), range(-1, counts[1] + 1)):
            square = _rectangle(low + side * (i, j), low + side * (i + 1, j + 1), SQUARE_POINTS)
            positions, is_seen = self.positions(square)
            if is_seen.all():
                color = DARK_SQUARE if (i + j) % 2 == 0 else LIGHT_SQUARE
                cv2.fillPoly(overlay, [positions], color, cv2.LINE_AA, 4)
        inside_opacity = FIRST_OPACITY if self.number == 0 else LATER_OPACITY
        opacity = np.where(visible, inside_opacity, HIDDEN_OPACITY)[..., None]
        self.canvas.pixels[:] = opacity * overlay + (1 - opacity) * self.canvas.pixels
        self.draw_outline()

    def draw_outline(self) -> None:
        """Draw the outline, with the edge nearer to the camera as a thick line."""
        board = self.proposal.board
        low, high, side = self._extent()
        self._curve(_rectangle(low - side, high + side, EDGE_POINTS), BOARD_LINE_WIDTH)
        if self.view.tilt >= FACING_RAD:
            centre, scale = (low + high) / 2, 1 + 2 * side / (high - low)
            ends = nearer_edge(self.proposal.prior, self.view, board)[1][:, :2]
            start, end = centre + (ends - centre) * scale
            self._curve(start + np.linspace(0, 1, EDGE_POINTS)[:, None] * (end - start), NEAR_EDGE_WIDTH)

    def _extent(self) -> tuple[Array, Array, Array]:
        """Return the least and greatest (x, y) of the board's points, and the sides of a square."""
        board = self.proposal.board
        low, high = board.points.min(0)[:2], board.points.max(0)[:2]
        return low, high, (high - low) / np.maximum(np.rint((high - low) / point_spacing(board)), 1)

    def positions(self, plane: Array) -> tuple[Any, NDArray[np.bool_]]:
        """Return canvas positions of points (N, 2) of the board, and which of them are visible."""
        points = self.view.cam_from_board @ np.pad(plane, ((0, 0), (0, 1)))
        pixels, valid = self.proposal.prior.camera.model.project_numpy(points)
        is_seen = valid & (np.abs(np.nan_to_num(pixels, nan=np.inf)) < MAX_PIXEL).all(1)
        return self.canvas.positions(np.where(is_seen[:, None], pixels, 0.0)), is_seen

    def _curve(self, plane: Array, width: int) -> None:
        """Draw the visible parts of a line (N, 2) of the board."""
        import cv2

        color: Color = VIEW_COLORS[self.number % len(VIEW_COLORS)]
        positions, is_seen = self.positions(plane)
        for i in np.flatnonzero(is_seen[:-1] & is_seen[1:]):
            cv2.line(self.canvas.pixels, positions[i], positions[i + 1], color, width, cv2.LINE_AA, 4)


def _draw_numbers(canvas: ImageCanvas, proposal: Proposal) -> None:
    """Number the boards at their centres, side by side if centres coincide."""
    centre = proposal.board.points.mean(0)[None, :2]
    used: list[Any] = []
    for i, view in enumerate(proposal.views):
        positions, is_seen = BoardDrawing(canvas, proposal, view, i).positions(centre)
        if is_seen.all():
            used.append(draw_view_number(canvas.pixels, positions[0] // 16, i, used))


def _visible_boundary(proposal: Proposal) -> Array:
    """Return pixels (N, 2) along the boundary of the visible directions: the limit of the model in the image."""
    camera = proposal.prior.camera
    theta = min(camera.image_theta_max(), camera.model.theta_max * (1 - 1e-6))
    azimuth = np.linspace(0, 2 * np.pi, BOUNDARY_POINTS)
    pixels, valid = camera.model.project_numpy(polar(np.full(BOUNDARY_POINTS, theta), azimuth))
    return pixels[valid]


def _rectangle(low: Array, high: Array, steps: int) -> Array:
    """Return points (4 steps + 1, 2) along a rectangle, closed."""
    t = np.linspace(0, 1, steps, endpoint=False)[:, None]
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    return np.concatenate([*(corners[i] + t * (corners[i + 1] - corners[i]) for i in range(4)), low[None]])
