"""The radial profile r(θ): distance from the principal point in the image over the angle from the axis."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.sphere import polar
from omnisight.quality.uncertainty import MAX_OFF_AXIS_RAD, Uncertainty
from omnisight.report.axes import CHART_WIDTH, Axes, chart, legend
from omnisight.report.html import Markup, element, join
from omnisight.report.report_data import DIRECTION_STEP_RAD, MIN_SCALE_PX, ReportData, radial_directions
from omnisight.report.section import Guide, Section

Array = NDArray[np.float64]

NUM_ANGLES, NUM_AZIMUTHS = 121, 24
# Corners that start farther off-axis leave the centre extrapolated, as in a mirror camera (radians).
MIN_INNER_RAD = np.radians(5.0)
# Height of the uncertainty axis relative to the largest calibrated value.
UNCERTAINTY_HEADROOM = 2.5
MAX_PERSPECTIVE_RAD = np.radians(89.9)
ANGLE_LABEL = "angle from the axis θ, degrees"
# Ideal projections r/f. They are scaled to agree with the camera at the outermost corner, to compare the shapes.
IDEAL_PROJECTIONS: dict[str, Callable[[Array], Array]] = {
    "stereographic, 2f tan θ/2": lambda t: 2 * np.tan(t / 2),
    "equidistant, f θ": lambda t: t,
    "equisolid, 2f sin θ/2": lambda t: 2 * np.sin(t / 2),
    "perspective, f tan θ": lambda t: np.where(
        t < MAX_PERSPECTIVE_RAD, np.tan(np.minimum(t, MAX_PERSPECTIVE_RAD)), np.nan
    ),
}


@dataclass(frozen=True)
class ProfileCurve:
    """The radial profile averaged over azimuths.

    Attributes
    ----------
    theta
        (A,) angles from the axis, radians.
    radius
        (A,) distance from the pixel of the axis, px.
    sigma
        (A,) standard deviation of `radius`, px, after the rotation of the camera frame that fits best.
    focal
        Focal length on the axis, px per radian.
    """

    theta: Array
    radius: Array
    sigma: Array
    focal: float


def radial_profile(data: ReportData) -> Section:
    """Draw the profile with ideal projections, and its standard deviation."""
    curve = _curve(data)
    degrees, outer = np.degrees(curve.theta), float(np.degrees(data.max_theta))
    inner = float(np.degrees(data.theta[data.inliers].min()))
    inner = inner if inner > np.degrees(MIN_INNER_RAD) else 0.0
    focal = f"focal length {curve.focal:.1f} px/rad ({curve.focal * np.pi / 180:.2f} px per degree) on the axis"
    edge = f"{degrees[-1]:.0f}°"
    limits = f"Corners reach {outer:.1f}° off-axis, the image {edge}."
    return Section(
        "profile",
        "Radial profile r(θ)",
        join(
            _profile_chart(data, curve, inner, outer),
            _sigma_chart(curve, inner, outer),
            element("p", f"The {focal}. {limits}", class_="note"),
        ),
        Guide(
            "Above: distance r from the principal point over the angle θ from the optical axis. Thin lines are ideal"
            " projections that agree at the outermost corner. Below: standard deviation of r (1σ), at a larger scale."
            " In hatched ranges there are no corners, and the curve is an extrapolation of the model.",
            "A smooth increasing curve, and a standard deviation of a fraction of a pixel up to the hatched range.",
            "To use the hatched range, add images with the board there. Otherwise mask that part of the images.",
        ),
    )


def extrapolated_spans(axes: Axes, inner: float, outer: float) -> list[Markup]:
    """Hatch the angles (degrees) below the innermost and above the outermost corner."""
    spans = [axes.x_span(0.0, inner, "extrapolated")] if inner else []
    if outer < axes.x_range[1] - 1e-6:
        spans.append(axes.x_span(outer, axes.x_range[1], "extrapolated"))
    return spans


def _profile_chart(data: ReportData, curve: ProfileCurve, inner: float, outer: float) -> Markup:
    degrees = np.degrees(curve.theta)
    axes = Axes((0.0, float(degrees[-1])), (0.0, float(curve.radius.max()) * 1.08), ANGLE_LABEL, "radius r, px")
    x, y = axes.positions(min(outer, axes.x_range[1]), axes.y_range[0])
    names = [
        ("line curve", "this camera"),
        *((f"line ideal ideal-{k}", name) for k, name in enumerate(IDEAL_PROJECTIONS)),
    ]
    return chart(
        axes.frame(),
        axes.clip(
            *extrapolated_spans(axes, inner, outer),
            *_ideal_projections(axes, curve, data.max_theta),
            axes.line(degrees, curve.radius, "curve"),
        ),
        legend(names, (62.0, 26.0)),
        element("text", f"corners to {outer:.0f}°", x=float(x) - 5, y=float(y) - 7, text_anchor="end", class_="on"),
        label=f"r(theta): corners reach {outer:.0f} degrees off-axis, the image {degrees[-1]:.0f} degrees.",
    )


def _sigma_chart(curve: ProfileCurve, inner: float, outer: float) -> Markup:
    degrees = np.degrees(curve.theta)
    calibrated = (degrees <= outer + 1e-9) & (degrees >= inner)
    largest = float(np.nan_to_num(curve.sigma[calibrated]).max(initial=MIN_SCALE_PX))
    limit = UNCERTAINTY_HEADROOM * largest
    box = 52.0, 12.0, CHART_WIDTH - 22, 118.0
    axes = Axes((0.0, float(degrees[-1])), (-limit, limit), ANGLE_LABEL, "± σ of r, px", box)
    return chart(
        axes.frame(),
        axes.clip(
            *extrapolated_spans(axes, inner, outer),
            axes.band(degrees, -curve.sigma, curve.sigma, "band"),
            axes.line(axes.x_range, (0.0, 0.0), "zero"),
        ),
        label=f"Standard deviation of r: at most {largest:.2g} px within the calibrated field of view.",
        height=160,
    )


def _curve(data: ReportData) -> ProfileCurve:
    camera = data.central_limit
    theta = np.linspace(0, min(data.displayed_theta, camera.model.theta_max * (1 - 1e-6), MAX_OFF_AXIS_RAD), NUM_ANGLES)
    # The axis itself has no radial direction.
    angles = np.maximum(theta, 2 * DIRECTION_STEP_RAD)
    grid = np.meshgrid(angles, 2 * np.pi * np.arange(NUM_AZIMUTHS) / NUM_AZIMUTHS, indexing="ij")
    angle, azimuth = (values.ravel() for values in grid)
    bearings = polar(angle, azimuth)
    pixels, valid = camera.model.project_numpy(bearings)
    centre, _ = camera.model.project_numpy(polar(np.zeros(1), np.zeros(1)))
    outwards = radial_directions(camera, angle, azimuth)
    unknown = np.full((len(bearings), 2, 2), np.nan)
    covariance = unknown if camera.covariance is None else Uncertainty.of(camera).projection(bearings)
    variance = np.einsum("ni,nij,nj->n", outwards, covariance, outwards)
    radius = _row_means(np.where(valid, np.linalg.norm(pixels - centre, axis=1), np.nan).reshape(len(theta), -1))
    sigma = np.sqrt(_row_means(np.maximum(variance, 0.0).reshape(len(theta), -1)))
    finite = np.isfinite(radius)
    step = np.full(4, DIRECTION_STEP_RAD)
    nearby, _ = camera.model.project_numpy(polar(step, np.array([0.0, 0.5, 1.0, 1.5]) * np.pi))
    focal = float(np.linalg.norm(nearby - centre, axis=1).mean() / DIRECTION_STEP_RAD)
    return ProfileCurve(theta[finite], radius[finite], sigma[finite], focal)


def _row_means(values: Array) -> Array:
    """Return the mean of the finite values in each row (A,), NaN if there are none."""
    finite = np.isfinite(values)
    count = finite.sum(1)
    return np.where(count > 0, np.where(finite, values, 0.0).sum(1) / np.maximum(count, 1), np.nan)


def _ideal_projections(axes: Axes, curve: ProfileCurve, max_theta: float) -> list[Markup]:
    radius = float(np.interp(max_theta, curve.theta, curve.radius))
    lines = list[Markup]()
    for k, projection in enumerate(IDEAL_PROJECTIONS.values()):
        scale = radius / float(projection(np.array(min(max_theta, MAX_OFF_AXIS_RAD))))
        # A perspective projection is not defined at an outermost corner beyond 90 degrees.
        if np.isfinite(scale):
            lines.append(axes.line(np.degrees(curve.theta), scale * projection(curve.theta), f"ideal ideal-{k}"))
    return lines
