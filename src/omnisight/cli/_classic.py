"""What `omnisight calibrate --method ocamcalib` says and writes."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from omnisight.calibration.ocamcalib import OcamCalibResult
from omnisight.camera import Camera
from omnisight.cli._console import console
from omnisight.pipeline.central import Calibration


def classic_camera(classic: OcamCalibResult, ours: Calibration) -> Camera:
    """Give the camera of Scaramuzza's method, with its error beside that of our own."""
    kept = ("verdict", "reasons", "images", "corners", "outliers")
    figures = {
        **{name: ours.camera.calibration[name] for name in kept},
        "method": "ocamcalib",
        **steps(classic)["refined"],
        "omnisight": {"rms": ours.rms, "mean": ours.mean},
    }
    return dataclasses.replace(ours.camera, model=classic.model, covariance=None, calibration=figures)


def steps(classic: OcamCalibResult) -> Mapping[str, Mapping[str, float]]:
    """Give rms and mean (px) after each step, by its name."""
    names = ("linear", "centred", "refined")
    return {name: dataclasses.asdict(getattr(classic, name)) for name in names}


def print_classic(classic: OcamCalibResult, ours: Calibration) -> None:
    """Print the error after each step of the method, and ours on the same corners."""
    from rich.table import Table

    table = Table("method", "rms px", "mean px", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    rows: dict[str, Any] = {
        "ocamcalib, linear steps": classic.linear,
        "ocamcalib, centre searched": classic.centred,
        "ocamcalib, refined": classic.refined,
        f"omnisight, {ours.chosen.name}": ours,
    }
    for name, figures in rows.items():
        table.add_row(name, f"{figures.rms:.3f}", f"{figures.mean:.3f}")
    out = console()
    out.print()
    out.print(table)
    out.print("The camera is the one of ocamcalib as asked; what is said above is of omnisight's own.", soft_wrap=True)
