"""Output of `omnisight calibrate`."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from omnisight.cli._console import console
from omnisight.cli._output import is_verbose, write_json
from omnisight.display import rounded
from omnisight.formats import SaveResult
from omnisight.formats.native import to_json
from omnisight.pipeline.calibration.calibration import Calibration
from omnisight.pipeline.detection.detection_advice import describe_image_outliers
from omnisight.quality.coverage import side_name
from omnisight.quality.evidence import Level
from omnisight.quality.noncentral_test import NonCentralityTest
from omnisight.quality.verdict import Verdict
from omnisight.targets import Checkerboard

if TYPE_CHECKING:
    from rich.console import Console

STYLES = {Level.GOOD: "bold green", Level.USABLE: "bold yellow", Level.DO_NOT_USE: "bold red"}
# Table rows and reasons that are printed without --verbose.
MAX_IMAGES, MAX_REASONS = 24, 3


def image_rows(calibration: Calibration) -> list[dict[str, Any]]:
    """Return one row per image: name, found, corners, rms and worst residual (px), note."""
    lengths = calibration.residual_lengths
    rows: list[dict[str, Any]] = []
    for image in calibration.observations.images:
        residuals, found = lengths[image.rows], len(image.views) > 0
        rows.append(
            {
                "name": image.name,
                "found": found,
                "corners": len(residuals),
                "rms": float(np.sqrt((residuals**2).mean())) if found else None,
                "worst": float(residuals.max()) if found else None,
                "note": "" if image.detection is None else image.detection.note,
            }
        )
    return rows


def print_json(calibration: Calibration) -> None:
    """Print the calibration as one JSON object."""
    rows = image_rows(calibration)
    detections, test = calibration.observations.detections, calibration.quality.noncentrality
    result: dict[str, Any] = {
        "images": rows,
        "pattern": None if detections is None else str(detections.board),
        "assumption": "" if detections is None else detections.assumption,
        "model": calibration.state.model.name,
        "rms": calibration.rms,
        "mean": calibration.mean,
        "held_out_rms": calibration.held_out_rms,
        "reason": calibration.selection.reason,
        "redetection": asdict(calibration.redetection),
        "verdict": str(calibration.verdict),
        "reasons": list(calibration.reasons),
        "remarks": list(_remarks(calibration, rows)),
        "candidates": [candidate.as_dict() for candidate in calibration.candidates],
        "noncentrality": None if test is None else test.as_dict(),
        "seconds": calibration.seconds,
        "camera": to_json(calibration.camera),
    }
    if calibration.central is not None:
        result["central"] = calibration.central.as_dict()
    if calibration.ocamcalib is not None:
        result["ocamcalib"] = calibration.ocamcalib.errors()
    write_json(result)


def print_report(calibration: Calibration, written: SaveResult | None) -> None:
    """Print images, models, camera, accuracy and verdict; with --verbose all rows, tests, remarks and timings."""
    out, rows = console(), image_rows(calibration)
    _print_images(out, rows)
    _print_models(out, calibration)
    if (detections := calibration.observations.detections) is not None and detections.assumption:
        _print_row(out, "board", detections.assumption)
    _print_row(out, "camera", _camera_summary(calibration))
    _print_row(out, "accuracy", _accuracy_summary(calibration))
    if is_verbose():
        _print_details(out, calibration, rows)
    print_verdict(out, calibration.verdict)
    method = ": the camera of ocamcalib, to which accuracy and verdict do not apply" if calibration.ocamcalib else ""
    _print_row(out, "written", f"{written.path}{method}" if written else "nothing")


def _print_images(out: "Console", rows: list[dict[str, Any]]) -> None:
    from rich.table import Table

    shown = rows
    if len(rows) > MAX_IMAGES and not is_verbose():
        worst = sorted(range(len(rows)), key=lambda i: -(np.inf if rows[i]["rms"] is None else rows[i]["rms"]))
        shown = [rows[i] for i in sorted(worst[:MAX_IMAGES])]
    has_notes = any(row["note"] for row in shown)
    table = Table("image", "corners", "rms px", "max px", *["note"] * has_notes, box=None, pad_edge=False)
    for column in table.columns[1:4]:
        column.justify = "right"
    for row in shown:
        figures = ["" if row[key] is None else f"{row[key]:.2f}" for key in ("rms", "worst")]
        table.add_row(row["name"], str(row["corners"] or "-"), *figures, *[row["note"]] * has_notes)
    out.print(table)
    if len(shown) < len(rows):
        out.print(f"({len(shown)} of {len(rows)} images, those with the largest rms; --verbose prints all)")
    out.print()


def _print_models(out: "Console", calibration: Calibration) -> None:
    from rich.table import Table

    table = Table("model", "params", "rms px", "held-out px", "probability", "", box=None, pad_edge=False)
    for column in table.columns[1:5]:
        column.justify = "right"
    for i, candidate in enumerate(calibration.candidates):
        probability = "" if candidate.probability is None else f"{candidate.probability:.0%}"
        figures = _figure(candidate.rms), _figure(candidate.held_out_rms), probability
        table.add_row(candidate.name, str(candidate.parameters), *figures, "" if i else "selected")
    if (central := calibration.central) is not None:
        figures = _figure(central.rms), _figure(central.held_out_rms)
        table.add_row(central.name, str(central.parameters), *figures, "", "central, for comparison")
    if calibration.ocamcalib is not None:
        for step, errors in calibration.ocamcalib.errors().items():
            table.add_row(f"ocamcalib, {step}", "", _figure(errors["rms"]), "", "", "written" * (step == "refined"))
    out.print(table)
    out.print()


def _camera_summary(calibration: Calibration) -> str:
    camera, observations = calibration.camera, calibration.observations
    total = len(observations.detections.images) if observations.detections else len(observations)
    used = len(observations.detections.found) if observations.detections else len(observations)
    outliers = int(calibration.outliers.sum())
    return (
        f"{calibration.best.name}, {camera.width}x{camera.height}, calibrated to"
        f" {np.degrees(camera.theta_max or 0):.0f}° off-axis, {used} of {total} images,"
        f" {len(observations.pixels)} corners, {outliers} {'outlier' if outliers == 1 else 'outliers'}"
    )


def _accuracy_summary(calibration: Calibration) -> str:
    error = calibration.held_out_rms
    text = f"rms {calibration.rms:.2f} px" if error is None else f"held-out error {error:.2f} px"
    uncertainty = calibration.quality.uncertainty
    pixels, _, theta, phi = uncertainty.worst()
    if np.isfinite(pixels):
        where = f"{np.degrees(theta):.0f}° off-axis {side_name(theta, phi)}"
        text += f"; projection uncertainty {rounded(uncertainty.rms())} px (1σ), at most {rounded(pixels)} px ({where})"
    return text


def _print_details(out: "Console", calibration: Calibration, rows: list[dict[str, Any]]) -> None:
    quality = calibration.quality
    if len(calibration.candidates) > 1:
        _print_row(out, "selected", calibration.selection.reason)
    if quality.spline_baseline is not None:
        _print_row(out, "spline", str(quality.spline_baseline))
    if quality.noncentrality is not None:
        _print_row(out, "central", str(quality.noncentrality))
        _print_central_error(out, quality.noncentrality)
    if quality.split_half is not None:
        test = quality.split_half
        _print_row(out, "halves", f"differ by {test.difference:.3f} px, {test.predicted:.3f} px predicted by noise")
    if calibration.state.warp.any():
        _print_row(out, "warp", _describe_warp(calibration))
    if calibration.observations.detections is not None:
        _print_row(out, "redetect", str(calibration.redetection))
    for remark in _remarks(calibration, rows):
        _print_row(out, "remark", remark)
    seconds = {name: value for name, value in calibration.seconds.items() if name != "total"}
    _print_row(out, "time", ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items()))


def _print_central_error(out: "Console", test: NonCentralityTest) -> None:
    from rich.table import Table

    error = test.central_error
    table = Table("central model at", "rms px", "max px", "max deg", box=None, pad_edge=False)
    for column in table.columns[1:]:
        column.justify = "right"
    for k in range(len(error.distances)):
        values = error.rms_pixels[k], error.max_pixels[k], np.degrees(error.max_angles[k])
        table.add_row(test.distance(k), *(f"{value:.3f}" for value in values))
    out.print(table)


def print_verdict(out: "Console", verdict: Verdict) -> None:
    """Print a verdict and its first reasons; with --verbose all of them."""
    out.print(f"{'verdict':<10}", end="")
    out.print(str(verdict).upper(), style=STYLES[verdict.level])
    reasons = verdict.reasons if is_verbose() else verdict.reasons[:MAX_REASONS]
    for reason in reasons:
        out.print(f"{'':<10}- {reason}", soft_wrap=True)
    if len(reasons) < len(verdict.reasons):
        out.print(f"{'':<10}({len(verdict.reasons) - len(reasons)} more with --verbose)")


def _remarks(calibration: Calibration, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield what else is worth knowing about images and board."""
    detections = calibration.observations.detections
    if detections is not None:
        outliers = describe_image_outliers(calibration.observations, [row["rms"] for row in rows])
        yield from filter(None, (detections.hint, *detections.notes, outliers))
    yield from calibration.verdict.remarks
    if detections is None or detections.board is None:
        return
    board = detections.board
    if isinstance(board, Checkerboard) and board.is_symmetric:
        yield (
            f"the {board} board looks the same upside-down, which is unambiguous for one camera but not for several;"
            f" use one of {board.columns}x{board.rows - 1} for those"
        )
    if ambiguous := sum(not d.located for image in detections.images for d in image.boards):
        yield f"{ambiguous} boards are only partly visible, with ambiguous corner numbers; the camera is unaffected"
    if board.unit == "squares":
        yield "lengths are in squares (the size of the board is not specified); the camera is unaffected"


def _describe_warp(calibration: Calibration) -> str:
    across, down = calibration.state.warp
    unit = calibration.observations.unit
    return (
        f"the board's middle is {across:+.3g} {unit} (across) and {down:+.3g} {unit} (down) off the plane of its edges,"
        " positive away from the camera; --flat takes it as flat"
    )


def _print_row(out: "Console", label: str, text: str) -> None:
    out.print(f"{label:<10}{text}", soft_wrap=True)


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
