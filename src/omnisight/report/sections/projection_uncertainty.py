"""How sure the camera is of itself at every angle and azimuth, in pixels and in degrees."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from omnisight.quality.checks import UNCERTAIN
from omnisight.report.axes import chart
from omnisight.report.color_scale import LogScale
from omnisight.report.html import Markup, element
from omnisight.report.report_data import Figure, Material
from omnisight.report.polar_axes import SIDE, Polar

Array = NDArray[np.float64]

# Colours of what is extrapolated end at so many times the largest value where corners were seen.
BEYOND = 2.0
WHOLE = (0.0, 2 * np.pi)


def uncertainty(m: Material) -> Figure:
    """Draw the two maps."""
    found = m.calibration.trust.uncertainty
    limit = UNCERTAIN[0] * m.far.px_unit
    pixels, angle, theta, _ = found.worst()
    worst = (
        f" At worst it is {pixels:.2g} px and {np.degrees(angle):.2g}°, the former {np.degrees(theta):.0f}° from the"
        " axis."
        if np.isfinite(pixels)
        else ""
    )
    maps = [
        _map(m, found.pixels, "pixels", lambda value: f"{value:.2g} px"),
        _map(m, np.degrees(found.angles), "degrees", lambda value: f"{value:.2g}°"),
    ]
    return Figure(
        "uncertainty",
        "How sure the camera is",
        element("div", *maps, class_="pair"),
        (
            "The field of view as above. The colour is how far off, one standard deviation, the camera puts a far"
            " point (left, in pixels) or the direction of a pixel (right, in degrees), after the camera frame has"
            " turned to fit best. Hatched is extrapolated: past the dashed circle no corner was seen, and the figure"
            " holds only if the model does.",
            f"Below {limit:.2g} px within the dashed circle, and even.{worst}",
            "Bright parts within the circle want images: put the board there, tilted by 30 to 45"
            f" degrees{m.where_best}.",
        ),
        "Uncertainty",
        wide=True,
    )


def _map(m: Material, values: Array, unit: str, said: Callable[[float], str]) -> Markup:
    found = m.calibration.trust.uncertainty
    known = found.shown & np.isfinite(values) & (values > 0)
    inside = values[known & found.calibrated[:, None]]
    outside = values[known]
    if not len(inside):
        return element("p", f"Not known in {unit}: so few images do not tell it.", class_="note")
    top = float(inside.max())
    scale = LogScale(float(inside.min()), float(np.clip(outside.max(), top, BEYOND * top)) * 1.001)
    step, sector = found.theta[1] - found.theta[0], 2 * np.pi / len(found.phi)
    disc = Polar(float(found.theta[known.any(1)].max() + step / 2))
    cells = [
        element(
            "path",
            element(
                "title",
                f"{np.degrees(t):.0f}° from the axis, azimuth {np.degrees(p):.0f}°: {said(float(values[i, k]))}",
            ),
            # Each reaches a little under the next, so that no seam shows; the axis itself is one.
            d=disc.cell(
                (t - step / 2, t + 0.53 * step), (p - sector / 2, p + 0.53 * sector) if i else (0.0, 2 * np.pi)
            ),
            fill=scale.colour(float(values[i, k])),
            class_="heat",
        )
        for i, t in enumerate(found.theta)
        for k, p in enumerate(found.phi)
        if known[i, k] and (i or not k)
    ]
    beyond = [
        disc.cell((t - step / 2, t + step / 2), (p - sector / 2, p + sector / 2))
        for i, t in enumerate(found.theta)
        for k, p in enumerate(found.phi)
        if known[i, k] and not found.calibrated[i]
    ]
    return chart(
        *cells,
        element("path", d="".join(beyond), class_="extrapolated over") if beyond else Markup(),
        disc.circle(m.reach, "cone"),
        disc.rings(),
        scale.bar((SIDE + 42, SIDE - 70), SIDE - 140, said),
        said=f"Uncertainty in {unit}: {said(float(inside.min()))} to {said(top)} where corners were seen.",
        width=SIDE + 125,
        height=SIDE,
    )
