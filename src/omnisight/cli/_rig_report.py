"""Output of `omnisight calibrate-rig`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from omnisight.cli._calibrate_report import print_verdict
from omnisight.cli._console import console
from omnisight.cli._output import is_verbose, write_json
from omnisight.display import rounded
from omnisight.geometry.rotation import quaternions
from omnisight.pipeline.rig_calibration.rig_calibration import RigCalibration

if TYPE_CHECKING:
    from rich.console import Console

RULES = {
    "name": "file names",
    "number": "numbers in the file names",
    "order": "order of the files",
    "time": "times",
    "timestamp": "timestamps in the file names",
}


def print_json(calibration: RigCalibration) -> None:
    """Print the calibration as one JSON object."""
    rig, metric = calibration.rig, calibration.rig.unit == "m"
    data: dict[str, Any] = {
        "cameras": [
            {
                "name": name,
                "model": camera.model.name,
                "rms": calibration.camera_rms(name),
                "held_out_rms": calibration.camera_held_out_rms(name),
                "images": calibration.images_of(name),
            }
            for name, camera in zip(rig.names, rig.cameras, strict=True)
        ],
        "sensor_from_rig": {name: _pose(calibration, name) for name in rig.names},
        "unit": rig.unit,
        "time_offsets_s": dict(zip(rig.names, rig.time_offsets, strict=True)) if rig.time_offsets else None,
        "simultaneous": calibration.rule,
        "pairs": [
            {
                "a": pair.a,
                "b": pair.b,
                "images": pair.agreeing,
                "shared_images": pair.shared,
                "rms": pair.rms if np.isfinite(pair.rms) else None,
            }
            for pair in calibration.pairs
        ],
        "boards": [_board(calibration, k) for k in range(len(calibration.estimate.observations.boards))],
        "rms": calibration.rms,
        "verdict": str(calibration.verdict),
        "reasons": list(calibration.reasons),
        "notes": list(calibration.notes),
        "seconds": calibration.seconds,
    }
    if not metric:
        data["note"] = "lengths are in squares of the board: translation and sigma are without unit, and *_m, *_mm null"
    write_json(data)


def _pose(calibration: RigCalibration, name: str) -> dict[str, Any]:
    """Return the pose of a camera and its standard deviations."""
    rig = calibration.rig
    pose, metric = rig.sensor_from_rig[rig.index(name)], rig.unit == "m"
    angle, length = calibration.sigmas(name)
    translation = pose.translation.tolist()
    return {
        "translation_m": translation if metric else None,
        "rotation_xyzw": quaternions(pose.rotation).tolist(),
        "sigma_mm": 1e3 * length if metric else None,
        "sigma_deg": float(np.degrees(angle)),
        **({} if metric else {"translation": translation, "sigma": length}),
    }


def _board(calibration: RigCalibration, board: int) -> dict[str, Any]:
    """Return the pose of a board relative to the first of its rigid set, and its standard deviations."""
    estimate, metric = calibration.estimate, calibration.rig.unit == "m"
    pose, (angle, length) = estimate.state.group_from_board.one(board), calibration.board_sigmas(board)
    translation = pose.translation.tolist()
    return {
        "name": estimate.observations.boards[board],
        "images": calibration.images_of_board(board),
        "rigid_with": estimate.observations.boards[estimate.rigid.sets[board]],
        "translation_m": translation if metric else None,
        "rotation_xyzw": quaternions(pose.rotation).tolist(),
        "sigma_mm": 1e3 * length if metric else None,
        "sigma_deg": float(np.degrees(angle)),
        **({} if metric else {"translation": translation, "sigma": length}),
    }


def print_report(calibration: RigCalibration, written: Path | None) -> None:
    """Print cameras, pairs, verdict and the file written; with --verbose all reasons and timings."""
    out = console()
    _print_cameras(out, calibration)
    _print_pairs(out, calibration)
    if len(calibration.estimate.observations.boards) > 1:
        _print_boards(out, calibration)
    rig = calibration.rig
    out.print(f"{'rig':<10}frame of {_reference(calibration)}; simultaneous images by {RULES[calibration.rule]}")
    if rig.time_offsets:
        offsets = ", ".join(f"{n} {1e3 * t:+.1f} ms" for n, t in zip(rig.names, rig.time_offsets, strict=True))
        out.print(f"{'time':<10}{offsets}")
    for note in calibration.notes:
        out.print(f"{'note':<10}{note}", soft_wrap=True)
    print_verdict(out, calibration.verdict)
    if is_verbose():
        seconds = {name: value for name, value in calibration.seconds.items() if name != "total"}
        out.print(f"{'seconds':<10}" + ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items()))
    out.print(f"{'written':<10}{written or 'nothing'}", soft_wrap=True)


def _print_cameras(out: "Console", calibration: RigCalibration) -> None:
    from rich.table import Table

    rig = calibration.rig
    unit, scale = ("mm", 1e3) if rig.unit == "m" else ("squares", 1.0)
    heads = f"position {unit}", f"± {unit}", "rotation deg", "± deg"
    table = Table("camera", "model", "images", "rms px", "held-out px", *heads, box=None, pad_edge=False)
    for column in table.columns[2:]:
        column.justify = "right"
    for name, camera, pose in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        angle, length = calibration.sigmas(name)
        position = " ".join(f"{scale * v:.1f}" for v in pose.inverse().translation + 0.0)
        turn = float(np.degrees(Rotation.from_matrix(pose.rotation).magnitude()))
        held_out = calibration.camera_held_out_rms(name)
        is_reference = name == _reference(calibration)
        table.add_row(
            name,
            camera.model.name,
            str(calibration.images_of(name)),
            f"{calibration.camera_rms(name):.3f}",
            "" if held_out is None else f"{held_out:.3f}",
            position,
            "" if is_reference else rounded(scale * length),
            f"{turn:.2f}",
            "" if is_reference else rounded(np.degrees(angle)),
        )
    out.print(table)
    out.print()


def _print_pairs(out: "Console", calibration: RigCalibration) -> None:
    from rich.table import Table

    table = Table("pair", "common images", "agree", "rms px", "", box=None, pad_edge=False)
    for column in table.columns[1:4]:
        column.justify = "right"
    links = [pair for pair in calibration.pairs if pair.is_link]
    weakest = min(links, key=lambda pair: pair.agreeing, default=None)
    for pair in calibration.pairs:
        rms = f"{pair.rms:.3f}" if np.isfinite(pair.rms) else ""
        note = "weakest link" if pair is weakest and len(calibration.rig) > 2 else ""
        table.add_row(f"{pair.a} - {pair.b}", str(pair.shared), str(pair.agreeing), rms, note)
    out.print(table)
    out.print()


def _print_boards(out: "Console", calibration: RigCalibration) -> None:
    """Print the boards, and which of them are rigidly connected."""
    from rich.table import Table

    observations, sets = calibration.estimate.observations, calibration.estimate.rigid.sets
    unit, scale = ("mm", 1e3) if calibration.rig.unit == "m" else ("squares", 1.0)
    table = Table("board", "images", "fixed to", f"± {unit}", "± deg", box=None, pad_edge=False)
    for column in (table.columns[1], *table.columns[3:]):
        column.justify = "right"
    for k, name in enumerate(observations.boards):
        angle, length = calibration.board_sigmas(k)
        is_first = sets[k] == k
        first = ("nothing" if sets.count(k) == 1 else "") if is_first else observations.boards[sets[k]]
        sigmas = ("", "") if is_first else (rounded(scale * length), rounded(np.degrees(angle)))
        table.add_row(name, str(calibration.images_of_board(k)), first, *sigmas)
    out.print(table)
    out.print()


def _reference(calibration: RigCalibration) -> str:
    """Return the name of the camera whose frame is the rig frame."""
    return calibration.estimate.observations.names[0]
