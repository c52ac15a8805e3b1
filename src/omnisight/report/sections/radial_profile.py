"""The curve r(theta) of the camera: how far from its centre the image shows an angle."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import polar
from omnisight.quality.uncertainty import LAST, Uncertainty
from omnisight.report.axes import WIDTH, Axes, chart
from omnisight.report.html import Markup, element, together
from omnisight.report.report_data import LEAST, STEP, Figure, Material, outwards_at

Array = NDArray[np.float64]

ANGLES, AZIMUTHS = 121, 24
# Where corners begin farther from the axis than this (radians), as with a mirror, the inner part is extrapolated too.
INNER = np.radians(5.0)
# The band is drawn up to so many times its largest value where corners were seen.
ROOM = 2.5
RIGHT_ANGLE = np.radians(89.9)
# Ideal lenses, r/f. They are drawn through the last corner, so that the shapes compare.
IDEAL: dict[str, Callable[[Array], Array]] = {
    "stereographic, 2f tan θ/2": lambda t: 2 * np.tan(t / 2),
    "equidistant, f θ": lambda t: t,
    "equisolid, 2f sin θ/2": lambda t: 2 * np.sin(t / 2),
    "perspective, f tan θ": lambda t: np.where(t < RIGHT_ANGLE, np.tan(np.minimum(t, RIGHT_ANGLE)), np.nan),
}


@dataclass(frozen=True)
class Curve:
    """The mean over all azimuths, as far as the image shows anything.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    radius
        (A,) distance from the pixel of the axis, px.
    sigma
        (A,) its standard deviation, px, the camera frame turned to fit best.
    focal
        px per radian on the axis.
    """

    theta: Array
    radius: Array
    sigma: Array
    focal: float


def profile(m: Material) -> Figure:
    """Draw the curve, and below it its band."""
    curve = _curve(m)
    reach, first = float(np.degrees(m.reach)), float(np.degrees(m.theta[m.usable].min()))
    first = first if first > np.degrees(INNER) else 0.0
    degrees = np.degrees(curve.theta)
    inside = (degrees <= reach + 1e-9) & (degrees >= first)
    upper = Axes(
        (0.0, float(degrees[-1])),
        (0.0, float(curve.radius.max()) * 1.08),
        "angle from the axis θ, degrees",
        "radius r, px",
    )
    widest = float(np.nan_to_num(curve.sigma[inside]).max(initial=LEAST))
    box = 52.0, 12.0, WIDTH - 22, 118.0
    lower = Axes(upper.x, (-ROOM * widest, ROOM * widest), upper.x_label, "± σ of r, px", box)
    focal = f"focal length {curve.focal:.1f} px per radian, {curve.focal * np.pi / 180:.2f} px per degree, on the axis"
    last = f"{degrees[-1]:.0f}°"
    return Figure(
        "profile",
        "How the lens bends angles into radii",
        together(
            chart(
                upper.frame(),
                upper.inside(
                    *hatched(upper, first, reach),
                    *_ideals(upper, curve, m.reach),
                    upper.line(degrees, curve.radius, "curve"),
                ),
                _legend(),
                _edge(upper, reach),
                said=f"r(theta): {focal}; corners reach {reach:.0f} degrees, the image {last}.",
            ),
            chart(
                lower.frame(),
                lower.inside(
                    *hatched(lower, first, reach),
                    lower.band(degrees, -curve.sigma, curve.sigma, "band"),
                    lower.line(lower.x, (0.0, 0.0), "zero"),
                ),
                said=f"The band of r: {widest:.2g} px at most where corners were seen.",
                height=160,
            ),
            element("p", f"The {focal}. Corners reach {reach:.1f}°, the image {last}.", class_="note"),
        ),
        (
            "Above: how far from its centre (r) the image shows what lies at an angle θ from the axis. Thin lines are"
            " ideal lenses that agree with it at the last corner. Below: the band of r, one standard deviation to each"
            " side, which would be too thin to see above. Hatched is where no corner was seen: there the curve is only"
            " the model's guess.",
            "A smooth curve that keeps rising, and a band of a fraction of a pixel that widens little before the "
            "hatched part.",
            "If you need the hatched angles, take images with the board there; otherwise mask that part of the images.",
        ),
        "r(θ)",
    )


def _curve(m: Material) -> Curve:
    camera = m.far
    shown_to = float(m.calibration.trust.coverage.edges[-1])
    last = min(max(m.reach, shown_to), camera.model.theta_max * (1 - 1e-6), LAST)
    theta = np.linspace(0, last, ANGLES)
    # Not the axis itself: it has no direction outwards.
    directions = np.meshgrid(np.maximum(theta, 2 * STEP), 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS, indexing="ij")
    angle, azimuth = (grid.ravel() for grid in directions)
    bearings = polar(angle, azimuth)
    pixels, valid = camera.model.project_numpy(bearings)
    middle, _ = camera.model.project_numpy(polar(np.zeros(1), np.zeros(1)))
    outwards = outwards_at(camera, angle, azimuth)
    covariance = Uncertainty.of(camera).projection(bearings)
    variance = np.einsum("ni,nij,nj->n", outwards, covariance, outwards)
    radius = _mean(np.where(valid, np.linalg.norm(pixels - middle, axis=1), np.nan).reshape(len(theta), -1))
    sigma = np.sqrt(_mean(np.maximum(variance, 0.0).reshape(len(theta), -1)))
    known = np.isfinite(radius)
    around, _ = camera.model.project_numpy(polar(np.full(4, STEP), np.array([0.0, 0.5, 1.0, 1.5]) * np.pi))
    steps = np.linalg.norm(around - middle, axis=1)
    return Curve(
        theta[known],
        radius[known],
        sigma[known],
        float(steps.mean() / STEP),
    )


def _mean(values: Array) -> Array:
    """Give the mean of each row (A,) of (A, B) over what is not NaN; NaN where all is."""
    known = np.isfinite(values)
    count = known.sum(1)
    return np.where(count > 0, np.where(known, values, 0.0).sum(1) / np.maximum(count, 1), np.nan)


def _ideals(axes: Axes, curve: Curve, reach: float) -> list[Markup]:
    at_reach = float(np.interp(reach, curve.theta, curve.radius))
    parts = list[Markup]()
    for k, ratio in enumerate(IDEAL.values()):
        scale = at_reach / float(ratio(np.array(min(reach, LAST))))
        if np.isfinite(scale):  # a perspective lens has no last corner past 90 degrees
            parts.append(axes.line(np.degrees(curve.theta), scale * ratio(curve.theta), f"ideal ideal-{k}"))
    return parts


def _legend() -> Markup:
    """Name the lines in the upper left, where a curve that rises is not."""
    lines = [("this camera", "curve"), *((name, f"ideal ideal-{k}") for k, name in enumerate(IDEAL))]
    return together(
        *(
            together(
                element("path", d=f"M62 {26 + 15 * i}h22", class_=f"line {class_}"),
                element("text", name, x=90, y=30 + 15 * i, class_="on"),
            )
            for i, (name, class_) in enumerate(lines)
        )
    )


def hatched(axes: Axes, first: float, reach: float) -> list[Markup]:
    """Hatch the angles (degrees) before the first and past the last corner, as far as the axes go."""
    parts = [axes.strip(reach, axes.x[1], "extrapolated")] if reach < axes.x[1] - 1e-6 else []
    return [axes.strip(0.0, first, "extrapolated"), *parts] if first else parts


def _edge(axes: Axes, reach: float) -> Markup:
    x, y = axes.at(min(reach, axes.x[1]), axes.y[0])
    return element("text", f"corners to {reach:.0f}°", x=float(x) - 5, y=float(y) - 7, text_anchor="end", class_="on")
