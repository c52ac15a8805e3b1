"""The entrance pupil shift of an axial camera: where its rays cross the axis, over the angle from the axis."""

import numpy as np

from omnisight.calibration.residual_weights import OUTLIER_SIGMA
from omnisight.optics.models.axial import Axial
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.uncertainty import MAX_OFF_AXIS_RAD
from omnisight.report.axes import Axes, chart
from omnisight.report.html import element, join
from omnisight.report.report_data import MIN_SCALE_PX, ReportData
from omnisight.report.section import Guide, Section
from omnisight.report.sections.radial_profile import ANGLE_LABEL, NUM_ANGLES, extrapolated_spans

# Height of the axis relative to the range of the calibrated curve with its band.
HEADROOM = 1.3


def pupil_shift(data: ReportData) -> Section | None:
    """Draw the pupil position with its standard deviation; None unless the camera is axial."""
    model, covariance, calibrated = data.camera.model, data.camera.covariance, data.pupil_shift
    if calibrated is None or not isinstance(model, Axial) or covariance is None:
        return None
    inner, outer = float(np.degrees(data.camera.theta_min)), float(np.degrees(data.max_theta))
    theta = np.linspace(0, min(data.displayed_theta, model.theta_max, MAX_OFF_AXIS_RAD), NUM_ANGLES)
    curve = PupilShift.of(model, covariance, theta, data.camera.theta_min)
    scale, unit = data.display_unit
    degrees, position, sigma = np.degrees(theta), scale * curve.position, scale * curve.sigma
    low = (scale * (calibrated.position - calibrated.sigma)).min()
    high = (scale * (calibrated.position + calibrated.sigma)).max()
    middle, half = (high + low) / 2, max(HEADROOM * (high - low) / 2, MIN_SCALE_PX)
    y_range = float(middle - half), float(middle + half)
    axes = Axes((0.0, float(degrees[-1])), y_range, ANGLE_LABEL, f"position on the axis, {unit}")
    length = data.format_length(calibrated.length, calibrated.length_sigma)
    significance = calibrated.length / max(calibrated.length_sigma, MIN_SCALE_PX)
    distances = np.linalg.norm(data.state.points(data.observations)[0][data.inliers], axis=1)
    nearest, farthest = (data.format_length(float(np.quantile(distances, share))) for share in (0.01, 0.99))
    summary = f"The entrance pupil shifts by {length} from {inner:.0f}° to {outer:.0f}° off-axis."
    return Section(
        "pupil-shift",
        "Entrance pupil shift",
        join(
            element("p", summary, class_="lead"),
            chart(
                axes.frame(),
                axes.clip(
                    *extrapolated_spans(axes, inner, outer),
                    axes.band(degrees, position - sigma, position + sigma, "band"),
                    axes.line(axes.x_range, (0.0, 0.0), "zero"),
                    axes.line(degrees, position, "curve"),
                ),
                label=f"Position of the entrance pupil on the axis over the angle. {summary}",
            ),
            element("p", f"Corner distances: {nearest} to {farthest}.", class_="note"),
        ),
        Guide(
            "The point where rays cross the optical axis, over the angle from the axis; positive is forward, zero is at"
            " the innermost corner. The band is ± 1σ. In hatched ranges there are no corners, and the curve is an"
            " extrapolation. The directions of the rays are in the radial profile.",
            f"A shift of more than {OUTLIER_SIGMA:.0f} standard deviations (here {significance:.0f}) with a narrow"
            " band. The curve matters most for points nearer than the boards, and not at all for distant points.",
            "If the band is wide, add images with the board very near and far, up to the image circle: only together"
            " they separate the pupil shift from the lens profile. If the curve is flat within its band, a central"
            " camera is sufficient.",
        ),
    )
