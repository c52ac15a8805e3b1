"""Drawing of a running capture: the image with the board, the corners so far, and where to hold the board next."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import polar
from omnisight.pipeline.calibration.capture_session import CaptureSession, JudgedCandidate
from omnisight.quality.coverage import SECTORS, Coverage
from omnisight.report.drawings.canvas import BLUE, GREEN, YELLOW, ImageCanvas
from omnisight.report.drawings.detections import draw_board_rows
from omnisight.report.drawings.next_view import BoardDrawing
from omnisight.report.drawings.next_view_panel import DOT_COLOR

# Longer side of the drawing, px: what a screen shows beside the figures.
SIZE_PX = 1100
BRIGHTNESS = 0.85
# Color and opacity of directions without corners.
UNCOVERED_COLOR, UNCOVERED_OPACITY = np.array((255, 90, 60)), 0.28
# Samples along each side of a cell.
CELL_STEPS = 12


def draw_capture(session: CaptureSession, judged: JudgedCandidate) -> NDArray[np.uint8]:
    """Return the drawing (H, W, 3): uncovered directions are red, the board of a stored image is green.

    The proposed board is drawn with its nearer edge thick.
    """
    image = judged.candidate.frame.image
    canvas = ImageCanvas(image, SIZE_PX / max(image.shape[:2]), brightness=BRIGHTNESS)
    field = session.detections.field
    canvas.field(field, BLUE)
    if session.coverage is not None and session.proposal is not None:
        _tint(canvas, session.coverage, session.proposal.prior.camera)
    for stored in session.detections.images:
        canvas.dots(stored.boards[0].pixels, DOT_COLOR)
    if session.proposal is not None and session.proposal.views:
        BoardDrawing(canvas, session.proposal, session.proposal.views[0], 0).draw_outline()
    if judged.detection is not None:
        draw_board_rows(canvas, judged.detection, session.detections, YELLOW if judged.advice else GREEN)
    return np.asarray(canvas.pixels, np.uint8)


def _tint(canvas: ImageCanvas, coverage: Coverage, camera: Any) -> None:
    """Tint the visible cells without enough corners."""
    import cv2

    mask = np.zeros(canvas.pixels.shape[:2], np.uint8)
    for ring, sector in np.argwhere(coverage.visible & ~coverage.covered):
        low, high = coverage.edges[ring : ring + 2]
        middle = 2 * np.pi * sector / SECTORS
        steps = np.linspace(-np.pi / SECTORS, np.pi / SECTORS, CELL_STEPS) + middle
        theta = np.concatenate([np.full(CELL_STEPS, low), np.full(CELL_STEPS, high)])
        pixels, valid = camera.model.project_numpy(polar(theta, np.concatenate([steps, steps[::-1]])))
        if valid.sum() > 2:
            cv2.fillPoly(mask, [canvas.positions(pixels[valid])], 1, cv2.LINE_8, 4)
    tinted = mask > 0
    mixed = (1 - UNCOVERED_OPACITY) * canvas.pixels[tinted] + UNCOVERED_OPACITY * UNCOVERED_COLOR
    canvas.pixels[tinted] = mixed.astype(np.uint8)
