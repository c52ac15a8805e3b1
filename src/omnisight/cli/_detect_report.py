"""What `omnisight detect` says."""

import json
import math
from typing import Any

from omnisight.cli._console import console
from omnisight.images.output_paths import image_labels
from omnisight.targets import Board, Checkerboard, Detection, Detections, ImageDetection, PointTarget

CLIPPED, DARK = 253, 70
BLURRED = 2.5  # px


def as_json(search: Detections) -> None:
    """Print one object on stdout, and nothing else."""
    names = image_labels([picture.path for picture in search.images])
    field = search.field
    result = {
        "format": "omnisight-corners",
        "pattern": None if search.board is None else str(search.board),
        "target": None if search.board is None else search.board.to_dict(),
        "hint": search.hint,
        "notes": list(search.notes),
        "field": None if field is None else field.describe(),
        "images": [
            {
                "name": name,
                "size": picture.size,
                "boards": [_board(search, d) for d in picture.boards],
                "sharpness": _finite(picture.sharpness),
                "blur": _finite(picture.blur),
                "exposure": _finite(picture.exposure),
                "note": picture.note,
            }
            for name, picture in zip(names, search.images, strict=True)
        ],
    }
    print(json.dumps(result, indent=2, allow_nan=False))


def print_report(search: Detections) -> None:
    """Print a line per image, and what they have in common."""
    from rich.table import Table

    out = console()
    table = Table("image", "boards", "corners", "blur px", "sharpness", "white", "note", box=None, pad_edge=False)
    for column in table.columns[1:6]:
        column.justify = "right"
    for picture, name in zip(search.images, image_labels([p.path for p in search.images]), strict=True):
        table.add_row(
            name,
            str(len(picture.boards) or "-"),
            str(sum(map(len, picture.boards)) or ""),
            _figure(picture.blur, ".2f"),
            _figure(picture.sharpness, ".2f"),
            _figure(picture.exposure, ".0f"),
            "; ".join(filter(None, (picture.note, *light(picture)))),
        )
    out.print(table)
    out.print()
    if search.board is None:
        out.print("no checkerboard found: for a board with markers or circles give --target")
    else:
        kind = "" if isinstance(search.board, Checkerboard) else f"{search.board.kind} "
        corners = sum(len(d) for p in search.images for d in p.boards)
        out.print(
            f"{kind}{search.board}: {len(search.found)} of {len(search.images)} images, {corners} corners",
            soft_wrap=True,
        )
    if search.field is not None:
        out.print(search.field.describe(), soft_wrap=True)
    for note in search.notes:
        out.print(f"note: {note}", soft_wrap=True)
    if search.hint:
        out.print(f"note: {search.hint}", soft_wrap=True)
    elif search.board is not None and not search.found:
        out.print(f"note: {advice(search.board)}", soft_wrap=True)


def advice(board: Board | PointTarget) -> str:
    """Say what to look at where a board is not found."""
    if isinstance(board, Checkerboard):
        return "does --pattern count inner corners, one less than squares each way? Is the board sharp, and lit evenly?"
    made = ", ".join(f"{key} {value}" for key, value in board.to_dict().items() if key != "target")
    return f"is it really this {board.kind}: {made}? Is it sharp, and large enough to read its markers?"


def light(picture: ImageDetection) -> list[str]:
    """Say what is wrong with an image's sharpness or light."""
    notes: list[str] = []
    if picture.blur > BLURRED:
        notes.append("blurred")
    if picture.boards and picture.exposure >= CLIPPED:
        notes.append("overexposed")
    if picture.boards and picture.exposure < DARK:
        notes.append("dark")
    return notes


def _board(search: Detections, detection: Detection) -> dict[str, Any]:
    shown = search.field
    outside = [] if shown is None else detection.ids[~shown.contains(detection.pixels)].tolist()
    return {
        "pattern": str(search.board),
        "ids": detection.ids.tolist(),
        "pixels": detection.pixels.tolist(),
        "covariance": detection.covariance.tolist(),
        "located": detection.located,
        "outside": outside,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _figure(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ""
