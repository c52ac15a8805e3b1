"""What `omnisight calibrate` says when it is done."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from omnisight.camera import Camera
from omnisight.cli._console import console
from omnisight.cli._standouts import standouts
from omnisight.formats import SaveResult
from omnisight.formats.native import to_json
from omnisight.pipeline.central import Calibration
from omnisight.pipeline.noncentral import RaysCalibration
from omnisight.pipeline.pictures import PicturesCalibration
from omnisight.quality.evidence import Level
from omnisight.ray_camera import RayCamera
from omnisight.report.drawings.detections import rows_of_pictures
from omnisight.targets import Checkerboard, Detections, PointTarget

if TYPE_CHECKING:
    from rich.console import Console

STYLES = {Level.GOOD: "bold green", Level.USABLE: "bold yellow", Level.DO_NOT_USE: "bold red"}


def rows(search: Detections, names: Sequence[str], calibration: Calibration | RaysCalibration) -> list[dict[str, Any]]:
    """Give one row per image: name, found, corners, rms and worst residual (px), note."""
    lengths = calibration.residual_lengths
    groups = iter(rows_of_pictures(search))
    table: list[dict[str, Any]] = []
    for picture, name in zip(search.images, names, strict=True):
        residual = lengths[next(groups)] if picture.boards else None
        table.append(
            {
                "name": name,
                "found": residual is not None,
                "corners": 0 if residual is None else len(residual),
                "rms": None if residual is None else float(np.sqrt((residual**2).mean())),
                "worst": None if residual is None else float(residual.max()),
                "note": picture.note or "",
            }
        )
    return table


def as_json(
    calibration: Calibration | RaysCalibration,
    result: PicturesCalibration,
    names: Sequence[str],
    camera: Camera | RayCamera,
    seconds: Mapping[str, float],
    more: Mapping[str, Any],
) -> None:
    """Print one object on stdout, and nothing else; `more` is what else to say."""
    search = result.search
    said = {
        "images": rows(search, names, calibration),
        "pattern": str(search.board),
        "model": camera.model.name,
        "rms": calibration.rms,
        "mean": calibration.mean,
        "held_out_rms": calibration.held_out_rms,
        "reason": calibration.reason,
        "second_look": asdict(result.redetection),
        "verdict": str(calibration.verdict),
        "reasons": list(calibration.verdict.reasons),
        "warnings": _notes(search, names, calibration),
        "candidates": [c.as_dict() for c in calibration.candidates],
        "seconds": dict(seconds),
        "camera": to_json(camera),
        **more,
    }
    print(json.dumps(said, indent=2, allow_nan=False))


def print_report(
    calibration: Calibration | RaysCalibration,
    result: PicturesCalibration,
    names: Sequence[str],
    seconds: Mapping[str, float],
    written: SaveResult | None,
    viewpoint: "Callable[[Console], None]",
) -> None:
    """Print the tables and what to make of them; `viewpoint` prints whether rays meet in a point."""
    search = result.search
    from rich.table import Table

    out = console()
    table = Table("image", "found", "corners", "rms px", "worst px", "note", box=None, pad_edge=False)
    for column in table.columns[2:5]:
        column.justify = "right"
    for row in rows(search, names, calibration):
        table.add_row(
            row["name"],
            "yes" if row["found"] else "no",
            str(row["corners"] or ""),
            _figure(row["rms"]),
            _figure(row["worst"]),
            row["note"],
        )
    out.print(table)
    models = Table("model", "parameters", "rms px", "held out px", box=None, pad_edge=False)
    for column in models.columns[1:]:
        column.justify = "right"
    for candidate in calibration.candidates:
        models.add_row(
            candidate.name, str(candidate.parameters), _figure(candidate.rms), _figure(candidate.held_out_rms)
        )
    if isinstance(calibration, RaysCalibration):
        other = calibration.central
        models.add_row(f"central: {other.name}", str(other.parameters), _figure(other.rms), _figure(other.held_out_rms))
    out.print()
    out.print(models)
    camera, trust = calibration.camera, calibration.trust
    out.print()
    out.print(calibration.reason, soft_wrap=True)
    if trust.spline_baseline is not None:
        out.print(f"ceiling: {trust.spline_baseline}.", soft_wrap=True)
    viewpoint(out)
    if calibration.candidates and calibration.state.warp.any():
        out.print(_bent(search, calibration), soft_wrap=True)
    out.print(
        f"{len(search.found)} of {len(search.images)} images, {len(calibration.views.pixels)} corners,"
        f" {int(calibration.outliers.sum())} doubtful; rms {calibration.rms:.3f} px, mean {calibration.mean:.3f} px;"
        f" corners reach {np.degrees(camera.theta_max or 0):.0f} degrees from the axis",
        soft_wrap=True,
    )
    if not isinstance(search.board, PointTarget):
        out.print(str(result.redetection), soft_wrap=True)
    pixels, angle, theta, _ = trust.uncertainty.worst()
    if np.isfinite(pixels):
        middle, middle_angle = trust.uncertainty.median()
        out.print(
            f"a far point lands {middle:.2g} px ({np.degrees(middle_angle):.2g} degrees) beside its place, one standard"
            f" deviation; at worst {pixels:.2g} px ({np.degrees(angle):.2g} degrees), {np.degrees(theta):.0f} degrees"
            " from the axis",
            soft_wrap=True,
        )
    for note in _notes(search, names, calibration):
        out.print(f"note: {note}", soft_wrap=True)
    out.print()
    out.print(f"verdict: {calibration.verdict}", style=STYLES[calibration.verdict.level], highlight=False)
    for reason in calibration.verdict.reasons:
        out.print(f"  - {reason}", soft_wrap=True)
    how = "read the corners" if isinstance(search.board, PointTarget) else "find boards"
    out.print(f"{seconds['detect']:.1f} s to {how}, {seconds['solve']:.1f} s to calibrate")
    if written is not None:
        out.print(f"written: {written.path}", soft_wrap=True)
    else:
        out.print("nothing written: give -o camera.json")


def _notes(search: Detections, names: Sequence[str], calibration: Calibration | RaysCalibration) -> list[str]:
    """Give what to know of the images beside the verdict."""
    odd = standouts(search, names, [row["rms"] for row in rows(search, names, calibration)])
    return [*filter(None, (search.hint, *search.notes, odd, *calibration.verdict.remarks)), *_about(search)]


def _about(search: Detections) -> list[str]:
    notes: list[str] = []
    board = search.board
    if isinstance(board, Checkerboard) and board.is_symmetric:
        notes.append(
            f"a {board} board looks the same upside-down: fine for one camera, unsafe for several;"
            f" {board.columns}x{board.rows - 1} would not."
        )
    if unsure := sum(not d.located for picture in search.images for d in picture.boards):
        notes.append(
            f"{unsure} boards are seen in part, and which part is not known: their corners count for the camera, which"
            " does not depend on it, but the origin of their poses is open."
        )
    if board is not None and board.unit == "squares":
        notes.append("lengths are in squares (no --square was given), which changes nothing about the camera.")
    return notes


def _bent(search: Detections, calibration: Calibration | RaysCalibration) -> str:
    across, down = calibration.state.warp
    unit = search.board.unit if search.board is not None else "squares"
    return (
        f"the board is bent: by {across:+.3g} {unit} across and {down:+.3g} {unit} down its middle stands off the plane"
        " of its edges (+ is away from the camera); the camera was calibrated with it so (--flat takes it as flat)"
    )


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
