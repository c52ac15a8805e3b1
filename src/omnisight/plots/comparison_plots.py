"""Plots of the comparison of two cameras."""

from typing import Any

import numpy as np

from omnisight.plots._figure import new_figure
from omnisight.quality.camera_comparison import CameraComparison


def plot_difference(comparison: CameraComparison) -> Any:
    """Plot the difference of two cameras after the best rotation (px) beside the uncertainty of each.

    Parameters
    ----------
    comparison
        The result of `compare`.

    Returns
    -------
    A figure of matplotlib.
    """
    c = comparison
    maps = [("difference after the best rotation", c.aligned.pixels)]
    maps += [
        (f"uncertainty of {name} (1σ)", sigma)
        for name, sigma in zip(c.names, c.uncertainties, strict=True)
        if sigma is not None
    ]
    figure = new_figure(width=4.2 * len(maps), height=3.8)
    high = max(float(np.nanmax(values[c.common])) for _, values in maps)
    panels = figure.subplots(1, len(maps), squeeze=False)[0]
    image = None
    for axes, (title, values) in zip(panels, maps, strict=True):
        shown = np.where(c.common, values, np.nan)
        image = axes.pcolormesh(c.u, c.v, shown, shading="nearest", vmin=0, vmax=high)
        axes.set(title=title, aspect="equal", xlim=(0, c.a.width), ylim=(c.a.height, 0), xlabel="u, px", ylabel="v, px")
    row, column = c.worst
    panels[0].plot(c.u[column], c.v[row], "wo", markerfacecolor="none", markeredgewidth=2)
    figure.colorbar(image, ax=list(panels), label="px", shrink=0.8)
    figure.suptitle(c.sentence)
    return figure
