"""What a machine reads from a report: the calibration as one JSON object."""

import json
from typing import Any

import numpy as np

from omnisight.formats.native import to_json
from omnisight.report.html import Markup
from omnisight.report.report_data import Material, Picture

VERSION = 1


def embedded(m: Material) -> Markup:
    """Give the script element that holds it."""
    # A "<" could end the element or begin a comment in it.
    text = json.dumps(said(m), allow_nan=False).replace("<", "\\u003c")
    return Markup(f'<script type="application/json" id="calibration">{text}</script>')


def said(m: Material) -> dict[str, Any]:
    """Give the object: lengths of residuals in px, poses as cam_from_board in the unit of the board, `board_unit`."""
    c, board = m.calibration, m.search.board
    return {
        "format": "omnisight-report",
        "version": VERSION,
        "command": list(m.command),
        "verdict": str(c.verdict),
        "checks": [{"name": k.name, "level": str(k.level), "sentence": k.sentence} for k in c.verdict.checks],
        "reason": c.reason,
        "candidates": [candidate.as_dict() for candidate in c.candidates],
        "viewpoint": None if m.asked is None else m.asked.as_dict(),
        "board": None if board is None else board.to_dict(),
        "board_unit": None if board is None else board.unit,
        "images": [_picture(m, picture) for picture in m.images],
        "camera": to_json(m.camera),
    }


def _picture(m: Material, picture: Picture) -> dict[str, Any]:
    state = m.calibration.state
    return {
        "name": picture.name,
        "corners": picture.corners,
        "doubtful": int(m.calibration.outliers[picture.rows].sum()),
        "rms": picture.rms if np.isfinite(picture.rms) else None,
        "worst": picture.worst if np.isfinite(picture.worst) else None,
        "note": picture.detection.note,
        "cam_from_board": [
            {"rotation": state.rotations[k].tolist(), "translation": state.translations[k].tolist()}
            for k in picture.views
        ],
    }
