"""What `omnisight calibrate-lines` says when it is done."""

import json
from collections.abc import Mapping

import numpy as np

from omnisight.calibration.lines import LinesCalibration
from omnisight.camera import Camera
from omnisight.cli._console import console
from omnisight.formats import Written
from omnisight.formats.native import to_json


def as_json(found: LinesCalibration, camera: Camera) -> None:
    """Print one object on stdout, and nothing else."""
    deviations = np.sqrt(np.diagonal(found.uncertainty.covariance))
    said = {
        "model": camera.model.name,
        "lines": len(found.chains),
        "arcs": len(found.line_of_arc),
        "rms": found.rms,
        "sigma": found.uncertainty.sigma,
        "inflation": found.uncertainty.inflation,
        "deviations": dict(zip(camera.model.param_names, deviations.tolist(), strict=True)),
        "bearing_sd_deg": float(np.degrees(found.bearing_sd)),
        "model_error_deg": float(np.degrees(found.misfit)),
        "not_determined": list(open_questions(found)),
        "warnings": list(found.warnings),
        "camera": to_json(camera),
    }
    print(json.dumps(said, indent=2, allow_nan=False))


def open_questions(found: LinesCalibration) -> tuple[str, ...]:
    """Say what the lines leave open."""
    return (
        "handedness: whether a mirror exchanges left and right",
        *(["the scale of tan(theta)"] if found.scale_held else []),
    )


def print_report(found: LinesCalibration, known: Mapping[str, float], written: Written | None) -> None:
    """Print the parameters with their deviations, and what to make of them."""
    from rich.table import Table

    out = console()
    table = Table("parameter", "value", "deviation", "unit", "", box=None, pad_edge=False)
    for column in table.columns[1:3]:
        column.justify = "right"
    model = found.camera.model
    deviations = np.sqrt(np.diagonal(found.uncertainty.covariance))
    for parameter, value, deviation in zip(model.parameters, model.params, deviations, strict=True):
        why = "known" if parameter.name in known else "fixed"
        table.add_row(
            parameter.name,
            f"{value:.6g}",
            f"{deviation:.2g}" if deviation else why,
            parameter.unit,
            parameter.doc,
        )
    out.print(f"model {model.name}")
    out.print(table)
    out.print()
    used = int((found.line_of_arc >= 0).sum())
    out.print(
        f"{len(found.chains)} lines of {used} arcs, {len(found.line_of_arc) - used} arcs are no lines;"
        f" rms {found.rms:.3f} px; lines reach {np.degrees(found.camera.theta_max or 0):.0f} degrees from the axis",
        soft_wrap=True,
    )
    out.print(
        f"bearings where the lines are: {np.degrees(found.bearing_sd):.2g} degrees (one standard deviation:"
        f" of the lines, widened {np.sqrt(found.uncertainty.inflation):.1f} times for the pixels of one edge err"
        f" together, and of {'the model' if found.shape_known else 'the model and its scale'})",
        soft_wrap=True,
    )
    out.print(f"not determined by lines: {'; '.join(open_questions(found))}", soft_wrap=True)
    for warning in found.warnings:
        out.print(f"note: {warning}", soft_wrap=True)
    out.print(
        f"written: {written.path}" if written is not None else "nothing written: give -o camera.json", soft_wrap=True
    )
