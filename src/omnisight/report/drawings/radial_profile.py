"""The radial profile r(θ) of a camera, drawn as text and as SVG."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.sphere import polar
from omnisight.report.axes import Axes, legend
from omnisight.report.drawings.cross_section import svg_document

Array = NDArray[np.float64]

NUM_ANGLES, NUM_AZIMUTHS = 400, 24
# Angle at which the focal length on the axis is measured, radians.
FOCAL_STEP_RAD = 1e-4
# Size of the drawing as text, characters, and as SVG.
TEXT_COLUMNS, TEXT_ROWS = 64, 14
WIDTH, HEIGHT = 620.0, 400.0


@dataclass(frozen=True)
class RadialProfile:
    """Distance from the principal point over the angle from the axis, averaged over azimuths.

    Attributes
    ----------
    theta_deg, radius
        (A,) the profile inside the image, degrees and px.
    focal
        Focal length on the axis, px per radian.
    centre
        Pixel of the axis.
    calibrated_deg
        Largest angle of the calibrated field of view, or None if unknown.
    """

    theta_deg: Array
    radius: Array
    focal: float
    centre: tuple[float, float]
    calibrated_deg: float | None

    @property
    def calibrated(self) -> NDArray[np.bool_]:
        """(A,) which angles are calibrated; all if the limit is unknown."""
        return self.theta_deg <= (np.inf if self.calibrated_deg is None else self.calibrated_deg)

    @property
    def equidistant(self) -> Array:
        """(A,) radius of an equidistant lens of the same focal length."""
        return self.focal * np.radians(self.theta_deg)


def radial_profile(camera: Camera) -> RadialProfile:
    """Return the radial profile from the axis to the edge of the image."""
    theta = np.linspace(0, min(camera.model.theta_max, np.pi * 0.999), NUM_ANGLES)[1:-1]
    azimuth = np.linspace(0, 2 * np.pi, NUM_AZIMUTHS, endpoint=False)
    centre, _ = camera.project([0.0, 0.0, 1.0])
    pixels, valid = camera.project(polar(*np.broadcast_arrays(theta[:, None], azimuth)))
    inside = valid & (camera.in_image(pixels) if camera.width else True)
    distance = np.where(inside, np.linalg.norm(pixels - centre, axis=-1), np.nan)
    visible = np.isfinite(distance).any(1)
    count = int(np.argmin(np.append(visible, False)))
    radius = np.nanmean(distance[:count], axis=1) if count else np.zeros(0)
    nearby, _ = camera.project([[FOCAL_STEP_RAD, 0.0, 1.0], [0.0, FOCAL_STEP_RAD, 1.0]])
    focal = float(np.mean(np.linalg.norm(nearby - centre, axis=1)) / FOCAL_STEP_RAD)
    calibrated_deg = None if camera.theta_max is None else float(np.degrees(camera.theta_max))
    return RadialProfile(np.degrees(theta[:count]), radius, focal, (float(centre[0]), float(centre[1])), calibrated_deg)


def profile_text(profile: RadialProfile) -> str:
    """Draw the profile in characters: `*` calibrated, `.` extrapolated, `-` equidistant lens of equal focal length."""
    if not len(profile.theta_deg):
        return "r(theta): no direction is visible in the image"
    x_max, y_max = profile.theta_deg[-1], profile.radius.max()
    grid = np.full((TEXT_ROWS, TEXT_COLUMNS), " ")
    theta = (np.arange(TEXT_COLUMNS) + 0.5) / TEXT_COLUMNS * x_max
    radius, equidistant = (np.interp(theta, profile.theta_deg, y) for y in (profile.radius, profile.equidistant))
    calibrated = theta <= (np.inf if profile.calibrated_deg is None else profile.calibrated_deg)
    for column in range(TEXT_COLUMNS):
        if equidistant[column] < y_max:
            grid[_text_row(equidistant[column] / y_max), column] = "-"
        grid[_text_row(radius[column] / y_max), column] = "*" if calibrated[column] else "."
    lines = [f"{f'{y_max:.0f}' if i == 0 else '':>7} |{''.join(row)}" for i, row in enumerate(grid)]
    lines += ["      0 +" + "-" * TEXT_COLUMNS, f"         0{'angle off-axis, degrees':^{TEXT_COLUMNS - 6}}{x_max:.0f}"]
    return "\n".join(["radius, px  (* calibrated, . extrapolated, - equidistant)", *lines])


def profile_svg(profile: RadialProfile) -> str:
    """Draw the profile with an equidistant lens of the same focal length; the extrapolated part is dashed."""
    x_max, y_max = float(profile.theta_deg[-1]), float(profile.radius.max())
    axes = Axes((0.0, x_max), (0.0, y_max), "angle off-axis, degrees", "radius, px", (60.0, 40.0, WIDTH - 40, 340.0))
    calibrated = np.where(profile.calibrated, profile.radius, np.nan)
    entries = [("line calibrated", "calibrated"), ("line extrapolated", "extrapolated"), ("line ideal", "equidistant")]
    return svg_document(
        axes.frame(),
        axes.clip(
            axes.line(profile.theta_deg, profile.equidistant, "ideal"),
            axes.line(profile.theta_deg, profile.radius, "extrapolated"),
            axes.line(profile.theta_deg, calibrated, "calibrated"),
        ),
        legend(entries, (60.0, 22.0), (150.0, 0.0)),
        width=WIDTH,
        height=HEIGHT,
        title="Radial profile r(theta)",
    )


def _text_row(fraction: float) -> int:
    return TEXT_ROWS - 1 - min(int(fraction * TEXT_ROWS), TEXT_ROWS - 1)
