"""The calibration of a rig as one JSON object, embedded in its report for programs."""

from typing import Any

import numpy as np

from omnisight.formats.native import rig_to_json
from omnisight.report.rigs.rig_report_data import RigReportData, RigView

# Version of the format, to be incremented on incompatible changes.
VERSION = 1


def to_dict(data: RigReportData) -> dict[str, Any]:
    """Return the JSON object: residual lengths in px, poses as rig_from_board in the unit of the rig."""
    calibration = data.calibration
    return {
        "format": "omnisight-rig-report",
        "version": VERSION,
        "command": list(data.options.command),
        "verdict": str(calibration.verdict),
        "checks": [{"name": c.name, "level": str(c.level), "sentence": c.sentence} for c in calibration.verdict.checks],
        "simultaneous": calibration.rule,
        "pairs": [
            {
                "a": pair.a,
                "b": pair.b,
                "shared_images": pair.shared,
                "images": pair.agreeing,
                "rms": _finite(pair.rms),
                "link": pair.is_link,
            }
            for pair in calibration.pairs
        ],
        "boards": list(calibration.estimate.observations.boards),
        "rigid_sets": calibration.board_sets,
        "images": [_view(view) for view in data.views],
        "rig": rig_to_json(data.rig),
    }


def _view(view: RigView) -> dict[str, Any]:
    pose = view.rig_from_board
    return {
        "camera": view.camera,
        "name": view.image,
        "number": view.number,
        "board": view.board,
        "corners": view.corners,
        "outliers": view.outliers,
        "rms": _finite(view.rms_px),
        "agrees": view.agrees,
        "rig_from_board": {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()},
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
