"""The radial profile r(θ) of a camera, drawn as text and as SVG."""

import numpy as np

from omnisight.pipeline.conversion.inspect import RadialProfile
from omnisight.report.axes import Axes, legend
from omnisight.report.drawings.cross_section import svg_document

# Size of the drawing as text, characters, and as SVG.
TEXT_COLUMNS, TEXT_ROWS = 64, 14
WIDTH, HEIGHT = 620.0, 400.0
LEGEND_STEP_PX = 200.0  # longer than the longest entry, "calibrated range unknown"


def profile_text(profile: RadialProfile) -> str:
    """Draw the profile in characters: `*` calibrated or all if that is unknown, `.` extrapolated, `-` equidistant."""
    if not len(profile.theta_deg):
        return "r(theta): not drawn, the optical axis is outside of the image"
    x_max, y_max = profile.theta_deg[-1], profile.radius.max()
    grid = np.full((TEXT_ROWS, TEXT_COLUMNS), " ")
    theta = (np.arange(TEXT_COLUMNS) + 0.5) / TEXT_COLUMNS * x_max
    radius, equidistant = np.interp(theta, profile.theta_deg, profile.radius), profile.focal * np.radians(theta)
    calibrated = profile.is_calibrated(theta)
    for column in range(TEXT_COLUMNS):
        if equidistant[column] < y_max:
            grid[_text_row(equidistant[column] / y_max), column] = "-"
        grid[_text_row(radius[column] / y_max), column] = "*" if calibrated[column] else "."
    lines = [f"{f'{y_max:.0f}' if i == 0 else '':>7} |{''.join(row)}" for i, row in enumerate(grid)]
    lines += ["      0 +" + "-" * TEXT_COLUMNS, f"         0{'angle off-axis, degrees':^{TEXT_COLUMNS - 6}}{x_max:.0f}"]
    known = "* calibrated, . extrapolated" if profile.calibrated_deg is not None else "* calibrated range unknown"
    return "\n".join([f"radius, px  ({known}, - equidistant)", *lines])


def profile_svg(profile: RadialProfile) -> str:
    """Draw the profile with an equidistant lens of the same focal length; the extrapolated part is dashed."""
    x_max, y_max = float(profile.theta_deg[-1]), float(profile.radius.max())
    axes = Axes((0.0, x_max), (0.0, y_max), "angle off-axis, degrees", "radius, px", (60.0, 40.0, WIDTH - 40, 340.0))
    calibrated = np.where(profile.is_calibrated(profile.theta_deg), profile.radius, np.nan)
    entries = [("line calibrated", "calibrated"), ("line extrapolated", "extrapolated"), ("line ideal", "equidistant")]
    if profile.calibrated_deg is None:
        entries[:2] = [("line calibrated", "calibrated range unknown")]
    return svg_document(
        axes.frame(),
        axes.clip(
            axes.line(profile.theta_deg, profile.focal * np.radians(profile.theta_deg), "ideal"),
            axes.line(profile.theta_deg, profile.radius, "extrapolated"),
            axes.line(profile.theta_deg, calibrated, "calibrated"),
        ),
        legend(entries, (60.0, 22.0), (LEGEND_STEP_PX, 0.0)),
        width=WIDTH,
        height=HEIGHT,
        title="Radial profile r(theta)",
    )


def _text_row(fraction: float) -> int:
    return TEXT_ROWS - 1 - min(int(fraction * TEXT_ROWS), TEXT_ROWS - 1)
