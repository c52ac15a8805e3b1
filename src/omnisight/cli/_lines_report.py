"""Report of `omnisight calibrate-lines`."""

import numpy as np

from omnisight.calibration.lines import LinesCalibration
from omnisight.cli._console import console
from omnisight.cli._output import write_json
from omnisight.display import rounded
from omnisight.formats import SaveResult
from omnisight.formats.native import to_json


def print_json(calibration: LinesCalibration) -> None:
    """Print the calibration as one JSON object."""
    camera, uncertainty = calibration.camera, calibration.uncertainty
    sigmas = np.sqrt(np.diagonal(uncertainty.covariance)).tolist()
    result = {
        "model": camera.model.name,
        "lines": len(calibration.lines),
        "arcs": len(calibration.arcs),
        "rms": calibration.rms,
        "sigma": uncertainty.sigma,
        "inflation": uncertainty.inflation,
        "deviations": dict(zip(camera.model.param_names, sigmas, strict=True)),
        "bearing_sd_deg": float(np.degrees(calibration.bearing_sigma)),
        "model_error_deg": float(np.degrees(calibration.estimate.model_error)),
        "not_determined": list(calibration.undetermined),
        "warnings": list(calibration.warnings),
        "camera": to_json(camera),
    }
    write_json(result)


def print_report(calibration: LinesCalibration, written: SaveResult | None) -> None:
    """Print the parameters with their standard deviations, the accuracy, warnings and the file written."""
    from rich.table import Table

    out, camera = console(), calibration.camera
    table = Table("parameter", "value", "1σ", "unit", "", box=None, pad_edge=False)
    for column in table.columns[1:3]:
        column.justify = "right"
    sigmas = np.sqrt(np.diagonal(calibration.uncertainty.covariance))
    for parameter, value, sigma in zip(camera.model.parameters, camera.model.params, sigmas, strict=True):
        sigma_text = rounded(sigma) if sigma else "fixed"
        table.add_row(parameter.name, f"{value:.6g}", sigma_text, parameter.unit, parameter.doc)
    out.print(table)
    out.print()
    inliers = int((calibration.line_of_arc >= 0).sum())
    rows = [
        (
            "camera",
            f"{camera.model.name}, {camera.width}x{camera.height}, lines up to"
            f" {np.degrees(camera.theta_max or 0):.0f}° off-axis, {len(calibration.lines)} lines,"
            f" {inliers} of {len(calibration.arcs)} arcs are inliers",
        ),
        ("accuracy", f"rms {calibration.rms:.3f} px; bearings {rounded(np.degrees(calibration.bearing_sigma))}° (1σ)"),
        ("unknown", "; ".join(calibration.undetermined)),
        *(("warning", warning) for warning in calibration.warnings),
        ("written", str(written.path) if written is not None else "nothing"),
    ]
    for label, text in rows:
        out.print(f"{label:<10}{text}", soft_wrap=True)
