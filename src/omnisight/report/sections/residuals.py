"""Residuals over angle, azimuth and image position: systematic patterns are errors of the model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.report.axes import CHART_WIDTH, Axes, chart, nice_floor, path_data, segment_path_data
from omnisight.report.html import Markup, element, join
from omnisight.report.report_data import ReportData
from omnisight.report.section import Guide, Section

Array = NDArray[np.float64]

NUM_RINGS, NUM_SECTORS = 14, 16
# The angle axis starts at zero unless the innermost corner is farther off-axis, degrees.
MAX_INNER_DEG = 10.0
# Fewest corners that a mean and its standard error are computed from.
MIN_CORNERS = 6
# Half the height of the axes in standard deviations, and the error bars of means in standard errors.
AXIS_SIGMAS, ERROR_BAR_SIGMAS = 4.0, 2.0
# Residuals drawn as dots, which bounds the size of the page. Means use all of them.
MAX_DOTS = 3000
PANEL_HEIGHT = 230.0
# Cells of the residual map along the image width, and the length of a typical arrow in cells.
MAP_CELLS, ARROW_CELLS = 16, 0.7
AZIMUTH_TICKS = ((0.0, "right"), (90.0, "bottom"), (180.0, "left"), (270.0, "top"), (360.0, "right"))


@dataclass(frozen=True)
class Abscissa:
    """The quantity that residuals are drawn over.

    Attributes
    ----------
    label
        Name and unit.
    values
        (N,) its value at each corner, degrees.
    edges
        Edges of the bins in which means are computed, degrees.
    ticks
        As in `Axes`.
    """

    label: str
    values: Array
    edges: Array
    ticks: tuple[tuple[float, str], ...] | None = None

    def bin_means(self, residuals: Array, inliers: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """Return centre (degrees), mean and standard error (px) of each bin with enough corners."""
        values, residuals = self.values[inliers], residuals[inliers]
        bins = np.clip(np.searchsorted(self.edges, values, side="right") - 1, 0, len(self.edges) - 2)
        members = [bins == k for k in range(len(self.edges) - 1)]
        means = [
            (values[m].mean(), residuals[m].mean(), residuals[m].std(ddof=1) / np.sqrt(m.sum()))
            for m in members
            if m.sum() >= MIN_CORNERS
        ]
        centre, mean, error = np.array(means).reshape(-1, 3).T
        return centre, mean, error


def residuals(data: ReportData) -> Section:
    """Draw radial and tangential residuals, and their mean over the image."""
    components = dict(zip(("radial", "tangential"), data.radial_and_tangential, strict=True))
    degrees = np.degrees(data.theta)
    rings = np.quantile(degrees[data.inliers], np.linspace(0, 1, NUM_RINGS + 1))
    sectors = np.linspace(0, 360, NUM_SECTORS + 1)
    by_angle = Abscissa("angle from the axis, degrees", degrees, rings)
    by_azimuth = Abscissa("side of the image", np.degrees(data.phi) % 360, sectors, AZIMUTH_TICKS)
    panels = [
        _panel(data, abscissa, component, f"{name} residual, px")
        for name, component in components.items()
        for abscissa in (by_angle, by_azimuth)
    ]
    inliers = data.inliers
    drawing, scale = residual_map(data.observations.pixels[inliers], data.residuals[inliers], data.camera.size)
    means = [by_angle.bin_means(component, data.inliers)[1] for component in components.values()]
    largest = max(float(np.abs(mean).max(initial=0.0)) for mean in means)
    return Section(
        "residuals",
        "Residuals",
        join(
            element("div", *panels, class_="pair"),
            element("div", drawing, class_="alone"),
            element("p", f"Residual map: mean residuals, magnified {scale:g} times.", class_="note middle"),
        ),
        Guide(
            "Dots are residuals (projected minus detected corner), split into a radial part, positive outwards, and a "
            "tangential part. The line is their mean with error bars of two standard errors. Arrows show the mean "
            "residual in each part of the image.",
            "Means near zero and arrows in random directions: only noise is left. Here the largest mean of a ring is "
            f"{largest:.3f} px, the standard deviation {data.sigma_px:.2f} px.",
            "A wave over the angle, or neighbouring arrows with the same direction, is an error of the model: "
            f"{_model_advice(data)}. A wave over the azimuth indicates a tilted lens or a board that is not flat or "
            "not regular.",
        ),
        wide=True,
    )


def _model_advice(data: ReportData) -> str:
    if data.is_central and data.camera.model.name != "spline":
        return "see Models compared"
    return "compare it with the standard deviation of the residuals"


def _panel(data: ReportData, abscissa: Abscissa, component: Array, label: str) -> Markup:
    box = (52.0, 12.0, CHART_WIDTH - 22, PANEL_HEIGHT - 42)
    limit = AXIS_SIGMAS * data.sigma_px
    low, high = float(abscissa.edges[0]), float(abscissa.edges[-1])
    x_range = (low, high) if abscissa.ticks else (low if low > MAX_INNER_DEG else 0.0, high * 1.02)
    axes = Axes(x_range, (-limit, limit), abscissa.label, label, box, abscissa.ticks)
    centre, mean, error = abscissa.bin_means(component, data.inliers)
    rows = np.flatnonzero(data.inliers)
    rows = rows[:: max(1, int(np.ceil(len(rows) / MAX_DOTS)))]
    error_bars = [
        axes.line([x, x], [y - ERROR_BAR_SIGMAS * e, y + ERROR_BAR_SIGMAS * e], "error")
        for x, y, e in zip(centre, mean, error, strict=True)
    ]
    return chart(
        axes.frame(),
        axes.clip(
            axes.dots(abscissa.values[rows], component[rows], "residual-dot"),
            axes.line(x_range, (0.0, 0.0), "zero"),
            *error_bars,
            axes.line(centre, mean, "mean"),
            axes.dots(centre, mean, "mean-dot"),
        ),
        label=f"{label} over {abscissa.label}; the largest mean is {np.abs(mean).max(initial=0):.3f} px.",
        height=PANEL_HEIGHT,
    )


def residual_map(pixels: Array, residuals: Array, size: tuple[int, int]) -> tuple[Markup, float]:
    """Draw the mean residual (N, 2) of each cell of the image as an arrow; return the magnification too."""
    width, height = size
    cell_size = width / MAP_CELLS
    cells = np.floor((pixels + 0.5) / cell_size).astype(int)
    members = [(cells == cell).all(1) for cell in np.unique(cells, axis=0)]
    members = [m for m in members if m.sum() >= MIN_CORNERS]
    starts = np.array([pixels[m].mean(0) for m in members]).reshape(-1, 2)
    means = np.array([residuals[m].mean(0) for m in members]).reshape(-1, 2)
    typical = float(np.sqrt((means**2).sum(1).mean())) if len(means) else 1.0
    scale = max(1.0, nice_floor(ARROW_CELLS * cell_size / max(typical, 1e-9)))
    heads = "".join(_arrow_head(p, v, cell_size / 6) for p, v in zip(starts, means * scale, strict=True))
    drawing = element(
        "svg",
        element("rect", x=-0.5, y=-0.5, width=width, height=height, class_="paper"),
        element("use", href="#extrapolated-image"),
        element("path", d=segment_path_data(starts, means * scale), class_="arrow"),
        element("path", d=heads, class_="head"),
        viewBox=f"-0.5 -0.5 {width} {height}",
        role="img",
        aria_label=f"Mean residuals over the image, magnified {scale:g} times",
        class_="image arrows",
    )
    return drawing, scale


def _arrow_head(start: Array, vector: Array, size: float) -> str:
    """Return SVG path data of the head of an arrow."""
    length = float(np.linalg.norm(vector))
    if length == 0:
        return ""
    along = vector / length * min(size, length)
    across = np.array([-along[1], along[0]]) * 0.45
    tip = start + vector
    return path_data([tip, tip - along + across, tip - along - across]) + "Z"
