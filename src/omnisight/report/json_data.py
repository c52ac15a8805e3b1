"""The calibration as one JSON object, embedded in the report for programs."""

import json
from typing import Any

import numpy as np

from omnisight.formats.native import to_json
from omnisight.report.html import Markup
from omnisight.report.report_data import ReportData, ReportImage

# Version of the format, to be incremented on incompatible changes.
VERSION = 1


def json_element(data: dict[str, Any]) -> Markup:
    """Return a script element with a JSON object."""
    # A "<" could end the element or start a comment.
    text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    return Markup(f'<script type="application/json" id="calibration">{text}</script>')


def to_dict(data: ReportData) -> dict[str, Any]:
    """Return the JSON object: residual lengths in px, poses as cam_from_board in `board_unit`."""
    board = data.detections.board if data.detections is not None else None
    return {
        "format": "omnisight-report",
        "version": VERSION,
        "command": list(data.options.command),
        "verdict": str(data.verdict),
        "checks": [{"name": c.name, "level": str(c.level), "sentence": c.sentence} for c in data.verdict.checks],
        "reason": data.selection_reason,
        "candidates": [candidate.as_dict() for candidate in data.candidates],
        "noncentral_test": None if data.noncentral_test is None else data.noncentral_test.as_dict(),
        "board": None if board is None else board.to_dict(),
        "board_unit": data.unit,
        "images": [_image_dict(data, image) for image in data.images],
        "camera": to_json(data.camera),
    }


def _image_dict(data: ReportData, image: ReportImage) -> dict[str, Any]:
    state = data.state
    return {
        "name": image.name,
        "corners": image.corners,
        "outliers": int(data.outliers[image.rows].sum()),
        "rms": image.rms_px if np.isfinite(image.rms_px) else None,
        "worst": image.max_px if np.isfinite(image.max_px) else None,
        "note": image.note,
        "cam_from_board": [
            {"rotation": state.rotations[k].tolist(), "translation": state.translations[k].tolist()}
            for k in image.views
        ],
    }
