"""The panel beside the drawing of proposed board placements: instructions and legend."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.report.drawings.canvas import WHITE, Color, write_text
from omnisight.view_planning.description import FACING_RAD, distance_text, error_text, image_side, nearer_edge
from omnisight.view_planning.information_prior import InformationPrior
from omnisight.view_planning.proposal import NextView, Proposal, unknown_error_px

Array = NDArray[np.float64]

GRAY, DOT_COLOR, HATCH_COLOR = (170, 170, 170), (120, 220, 255), (200, 200, 200)
VIEW_COLORS: tuple[Color, ...] = ((90, 255, 120), (255, 120, 255), (80, 220, 255), (255, 170, 60), (255, 255, 110))
# Opacity of the uncertainty over the image.
UNCERTAINTY_OPACITY = 0.45
# Lower end of the color scale as a fraction of the unknown error.
MIN_ERROR_FRACTION = 0.01
# Width of the panel, and heights of its heading, of an instruction and of the legend, px.
PANEL_WIDTH, HEADING_HEIGHT, ENTRY_HEIGHT, LEGEND_HEIGHT = 560, 110, 150, 330
MARGIN = 24
BACKGROUND_LEVEL = 24
NUMBER_RADIUS_PX = 34


def panel_height(proposal: Proposal) -> int:
    """Return the height of the panel, px."""
    return HEADING_HEIGHT + ENTRY_HEIGHT * len(proposal.views) + LEGEND_HEIGHT


def draw_panel(proposal: Proposal, height: int) -> Any:
    """Return the panel (height, PANEL_WIDTH, 3)."""
    panel = TextPanel(height)
    panel.write("Hold the board like this", 1.0)
    if len(proposal.views) > 1:
        panel.write("one image each, in this order", 0.65, GRAY)
    panel.y += 14
    for i, view in enumerate(proposal.views):
        draw_view_number(panel.pixels, (58, panel.y + 52), i)
        _write_view(panel, proposal, view, VIEW_COLORS[i % len(VIEW_COLORS)])
    panel.y = height - LEGEND_HEIGHT
    panel.write("Projection uncertainty", 0.85)
    _draw_color_bar(panel, unknown_error_px(proposal.prior))
    _draw_symbols(panel)
    worst = proposal.worst
    side = image_side(proposal.prior, worst.pixel)
    panel.write(f"worst: {np.degrees(worst.theta):.0f} degrees, {side}", 0.65, GRAY)
    return panel.pixels


class TextPanel:
    """A dark panel with lines of text from top to bottom."""

    def __init__(self, height: int) -> None:
        self.pixels = np.full((height, PANEL_WIDTH, 3), BACKGROUND_LEVEL, np.uint8)
        self.y = 20

    def write(self, text: str, size: float = 0.7, color: Color = WHITE, x: int = MARGIN) -> None:
        """Write the next line of text."""
        self.y += round(44 * size)
        write_text(self.pixels, text, (x, self.y), size, color, 2 if size > 0.8 else 1)


def draw_view_number(pixels: Any, position: ArrayLike, number: int, used: Sequence[Any] = ()) -> Any:
    """Draw the number of a view in a disc, moved to the right of `used` positions; return its position."""
    import cv2

    centre = np.clip(position, NUMBER_RADIUS_PX, np.array(pixels.shape[1::-1]) - NUMBER_RADIUS_PX)
    while any(np.linalg.norm(centre - other) < 2 * NUMBER_RADIUS_PX for other in used):
        centre = np.add(centre, (2 * NUMBER_RADIUS_PX, 0))
    x, y = int(centre[0]), int(centre[1])
    cv2.circle(pixels, (x, y), NUMBER_RADIUS_PX, (0, 0, 0), -1, cv2.LINE_AA)
    cv2.circle(pixels, (x, y), NUMBER_RADIUS_PX - 3, VIEW_COLORS[number % len(VIEW_COLORS)], -1, cv2.LINE_AA)
    text = str(number + 1)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.3, 3)
    write_text(pixels, text, (x - width // 2, y + height // 2), 1.3, (0, 0, 0), 3)
    return centre


def uncertainty_level(prior: InformationPrior, errors: Array) -> Array:
    """Return the position of errors (px) on the color scale: logarithmic from 0 to 1 (unknown)."""
    high = unknown_error_px(prior)
    low = MIN_ERROR_FRACTION * high
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(np.clip(np.log(np.maximum(errors, low) / low) / np.log(high / low), 0, 1), nan=1.0)


def uncertainty_color(level: Any) -> Any:
    """Return the RGB colors (..., 3) of positions (...) on the color scale."""
    import cv2

    bgr = cv2.applyColorMap((255 * np.atleast_2d(level)).astype(np.uint8), cv2.COLORMAP_TURBO)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def _write_view(panel: TextPanel, proposal: Proposal, view: NextView, color: Color) -> None:
    prior, board, x = proposal.prior, proposal.board, 110
    panel.write(f"{distance_text(view, board)} away", 0.75, color, x)
    if view.tilt >= FACING_RAD:
        panel.write(f"tilted {np.degrees(view.tilt):.0f} degrees:", 0.7, WHITE, x)
        panel.write(f"{nearer_edge(prior, view, board)[0]} edge (thick) nearer", 0.7, WHITE, x)
    else:
        panel.write("facing the camera", 0.7, WHITE, x)
    panel.write(f"worst {error_text(prior, view.before)} -> {error_text(prior, view.after)}", 0.65, GRAY, x)
    panel.y += 22


def _draw_color_bar(panel: TextPanel, unknown_px: float) -> None:
    ramp = uncertainty_color(np.linspace(0, 1, PANEL_WIDTH - 2 * MARGIN))[0]
    top = panel.y + 12
    colors = (1 - UNCERTAINTY_OPACITY) * 60 + UNCERTAINTY_OPACITY * ramp + 40 * UNCERTAINTY_OPACITY
    panel.pixels[top : top + 26, MARGIN:-MARGIN] = colors
    for text, x in (
        (f"{MIN_ERROR_FRACTION * unknown_px:.1g} px", MARGIN),
        (f"{np.sqrt(MIN_ERROR_FRACTION) * unknown_px:.1g} px", PANEL_WIDTH // 2 - MARGIN),
        (f"{unknown_px:.0f} px: unknown", PANEL_WIDTH - 174),
    ):
        write_text(panel.pixels, text, (x, top + 52), 0.6)
    panel.y = top + 70


def _draw_symbols(panel: TextPanel) -> None:
    import cv2

    panel.write("corners so far", 0.65, WHITE, 80)
    for x in (34, 46, 58):
        cv2.circle(panel.pixels, (x, panel.y - 7), 3, DOT_COLOR, -1, cv2.LINE_AA)
    panel.write("extrapolated: beyond all corners", 0.65, WHITE, 80)
    for x in (28, 40, 52):
        cv2.line(panel.pixels, (x, panel.y + 2), (x + 16, panel.y - 16), HATCH_COLOR, 2, cv2.LINE_AA)
    panel.write("edge nearer to the camera", 0.65, WHITE, 80)
    cv2.line(panel.pixels, (30, panel.y - 7), (64, panel.y - 7), WHITE, 10, cv2.LINE_AA)
