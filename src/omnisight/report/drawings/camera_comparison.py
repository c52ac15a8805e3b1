"""Drawing of the difference of two cameras beside their uncertainties."""

from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.quality.camera_comparison import CameraComparison
from omnisight.report.color_scale import viridis
from omnisight.report.drawings.canvas import WHITE, write_text
from omnisight.report.number_format import capitalize

Array = NDArray[np.float64]

PANEL_WIDTH, GAP, TITLE_HEIGHT, BAR_HEIGHT, BAR_WIDTH = 460, 20, 34, 40, 300
BACKGROUND, OUTSIDE_LEVEL = 24, 70
LEGEND_COLUMNS = 52
GRAY = (170, 170, 170)
# Characters of the name of a camera in a title.
MAX_NAME = 28
# Values below this fraction of the largest one have the darkest colour.
MIN_FRACTION = 0.01


def draw_comparison(comparison: CameraComparison) -> NDArray[np.uint8]:
    """Draw maps of the difference in px and degrees and of both uncertainties over the image of the first camera.

    The maps in px share a logarithmic colour scale. A circle marks the largest difference after the best rotation;
    gray is outside the common calibrated field of view.

    Returns
    -------
    (H, W, 3) RGB image.
    """
    c = comparison
    shown = [c.aligned.pixels, c.fixed.pixels, *(sigma for sigma in c.uncertainties if sigma is not None)]
    high = max(float(np.nanmax(values[c.common])) for values in shown)
    px = Scale(high, "px")
    degrees = Scale(float(np.degrees(np.nanmax(c.aligned.angles[c.common]))), "deg")
    maps = [
        ("difference after the best rotation", c.aligned.pixels, px),
        ("difference without rotation", c.fixed.pixels, px),
        ("difference after the best rotation, angle", np.degrees(c.aligned.angles), degrees),
        *(
            (f"uncertainty (1 sigma) of {_short(name)}", sigma, px)
            for name, sigma in zip(c.names, c.uncertainties, strict=True)
        ),
    ]
    panels = [_panel(c, title, values, scale) for title, values, scale in maps]
    panels.append(_legend(c, px, degrees, panels[0].shape))
    page = np.concatenate([np.concatenate(panels[k : k + 3], axis=1) for k in (0, 3)])
    return np.pad(page, ((0, 0), (0, GAP), (0, 0)), constant_values=BACKGROUND)


def _short(name: str) -> str:
    """Return a name with its middle left out if it is long."""
    return name if len(name) <= MAX_NAME else f"{name[: MAX_NAME // 2 - 2]}...{name[-MAX_NAME // 2 + 1 :]}"


class Scale:
    """A logarithmic colour scale from a hundredth of the largest value."""

    def __init__(self, high: float, unit: str) -> None:
        self.high, self.unit = max(high, 1e-12), unit

    def colors(self, values: Any) -> Any:
        """Return the colours (..., 3) of values."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return viridis(1 - np.log(np.maximum(values, 1e-300) / self.high) / np.log(MIN_FRACTION))


def _panel(comparison: CameraComparison, title: str, values: Array | None, scale: Scale) -> Any:
    """Draw a map over the image with its title and its root mean square."""
    import cv2

    c = comparison
    height = round(PANEL_WIDTH * c.a.height / c.a.width)
    page = np.full((TITLE_HEIGHT + height + GAP, PANEL_WIDTH + GAP, 3), BACKGROUND, np.uint8)
    area = page[TITLE_HEIGHT : TITLE_HEIGHT + height, GAP:]
    if values is None:
        write_text(page, title, (GAP, TITLE_HEIGHT - 12), 0.5, GRAY)
        write_text(area, "not in the file", (PANEL_WIDTH // 2 - 60, height // 2), 0.5, GRAY)
        return page
    rms = float(np.sqrt(np.nanmean(values[c.common] ** 2)))
    write_text(page, f"{title}: {rms:.2g} {scale.unit} rms", (GAP, TITLE_HEIGHT - 12), 0.5)
    colors = np.where(c.common[..., None], scale.colors(np.where(c.common, values, scale.high)), OUTSIDE_LEVEL)
    area[:] = cv2.resize(colors.astype(np.uint8), (PANEL_WIDTH, height), interpolation=cv2.INTER_NEAREST)
    row, column = c.worst
    zoom = PANEL_WIDTH / c.a.width
    centre = round(float(c.u[column] + 0.5) * zoom), round(float(c.v[row] + 0.5) * zoom)
    cv2.circle(area, centre, 11, (0, 0, 0), 4, cv2.LINE_AA)
    cv2.circle(area, centre, 11, WHITE, 2, cv2.LINE_AA)
    return page


def _legend(comparison: CameraComparison, px: Scale, degrees: Scale, shape: tuple[int, ...]) -> Any:
    """Draw the colour scales and the verdict."""
    page = np.full(shape, BACKGROUND, np.uint8)
    y = TITLE_HEIGHT
    for scale in (px, degrees):
        page[y : y + 16, GAP : GAP + BAR_WIDTH] = scale.colors(
            scale.high * MIN_FRACTION ** np.linspace(1, 0, BAR_WIDTH)
        )
        for share, x in ((1.0, GAP), (0.5, GAP + BAR_WIDTH // 2 - 30), (0.0, GAP + BAR_WIDTH - 60)):
            value = scale.high * MIN_FRACTION**share
            write_text(page, f"{value:.2g} {scale.unit}", (x, y + 34), 0.45, GRAY)
        y += BAR_HEIGHT + 16
    text = (
        f"{capitalize(comparison.sentence)}. Circle: largest difference, {comparison.worst_place}."
        " The colour scales are logarithmic."
    )
    for line in wrap(text.replace("°", " deg"), LEGEND_COLUMNS):
        write_text(page, line, (GAP, y + 10), 0.45)
        y += 20
    return page
