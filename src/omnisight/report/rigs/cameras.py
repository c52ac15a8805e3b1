"""Table of the cameras of a rig: residuals, poses and uncertainty."""

import numpy as np
from scipy.spatial.transform import Rotation

from omnisight.report.html import Markup, element, join, table
from omnisight.report.rigs.rig_report_data import RigReportData
from omnisight.report.section import Guide, Section


def cameras(data: RigReportData) -> Section:
    """List the cameras with their poses."""
    _, unit = data.display_unit
    columns = (
        "camera",
        "model",
        "image",
        "off-axis",
        "images",
        "rms px",
        "without outliers",
        "held-out px",
        f"position {unit}",
        f"± {unit}",
        "rotation",
        "±",
    )
    return Section(
        "cameras",
        "Cameras",
        join(table(columns, [_row(data, name) for name in data.rig.names], class_="numbers")),
        Guide(
            f"Position (x right, y down, z forward) and rotation of each camera in the frame of {data.reference}. ± is"
            " the standard deviation (1σ) of the length of the translation and of the angle of the rotation of"
            " sensor_from_rig. The held-out error is that of simultaneous images left out of the calibration.",
            "A held-out error close to the rms without outliers, and a rotation that is certain to a pixel or less.",
            "If a camera has much larger residuals than the others, see Residuals. If its pose is uncertain, take more"
            " images with the board where it and another camera see it.",
        ),
        wide=True,
    )


def _row(data: RigReportData, name: str) -> Markup:
    calibration, rig = data.calibration, data.rig
    k, (scale, _) = rig.index(name), data.display_unit
    camera, pose = rig.cameras[k], rig.sensor_from_rig[k]
    angle, length = calibration.sigmas(name)
    turn = float(np.degrees(Rotation.from_matrix(pose.rotation).magnitude()))
    held_out, is_reference = calibration.camera_held_out_rms(name), name == data.reference
    reach = camera.theta_max
    known = calibration.calibrations[name] is None
    cells = (
        f"{camera.model.name}{' (known)' if known else ''}",
        f"{camera.width}×{camera.height}",
        "" if reach is None else f"{np.degrees(reach):.0f}°",
        str(calibration.images_of(name)),
        f"{calibration.camera_rms(name):.3f}",
        f"{data.inlier_rms(name):.3f}",
        "unknown" if held_out is None else f"{held_out:.3f}",
        ", ".join(f"{value:.1f}".replace("-", "−") for value in np.round(scale * data.centre(name), 1) + 0.0),
        "–" if is_reference else f"{scale * length:.2g}",
        f"{turn:.2f}°",
        "–" if is_reference else f"{np.degrees(angle):.2g}°",
    )
    mark = element(
        "svg", element("rect", width=12, height=12, fill=data.color(name)), width=12, height=12, class_="key"
    )
    return element(
        "tr",
        element("th", mark, f" {name}", scope="row"),
        element("td", cells[0]),
        *(element("td", cell, class_="number") for cell in cells[1:]),
    )
