"""Output of `omnisight detect`."""

import math
from typing import Any

from omnisight.cli._console import console
from omnisight.cli._output import write_json
from omnisight.images.output_paths import image_labels
from omnisight.pipeline.detection_advice import board_advice, light_problems
from omnisight.targets import Checkerboard, Detection, Detections


def as_json(search: Detections) -> None:
    """Print one JSON object on stdout, and nothing else."""
    names = image_labels([image.path for image in search.images])
    field = search.field
    result = {
        "format": "omnisight-corners",
        "pattern": None if search.board is None else str(search.board),
        "target": None if search.board is None else search.board.to_dict(),
        "assumption": search.assumption,
        "hint": search.hint,
        "notes": list(search.notes),
        "field": None if field is None else field.describe(),
        "images": [
            {
                "name": name,
                "size": image.size,
                "boards": [_board(search, d) for d in image.boards],
                "sharpness": _finite(image.sharpness),
                "blur": _finite(image.blur),
                "exposure": _finite(image.exposure),
                "note": image.note,
            }
            for name, image in zip(names, search.images, strict=True)
        ],
    }
    write_json(result)


def print_report(search: Detections) -> None:
    """Print one row per image, notes on the set, and the result last."""
    from rich.table import Table

    out = console()
    table = Table("image", "boards", "corners", "blur px", "sharpness", "white", "note", box=None, pad_edge=False)
    for column in table.columns[1:6]:
        column.justify = "right"
    for image, name in zip(search.images, image_labels([image.path for image in search.images]), strict=True):
        table.add_row(
            name,
            str(len(image.boards) or "-"),
            str(sum(map(len, image.boards)) or ""),
            _number(image.blur, ".2f"),
            _number(image.sharpness, ".2f"),
            _number(image.exposure, ".0f"),
            "; ".join(filter(None, (image.note, *light_problems(image)))),
        )
    out.print(table)
    out.print()
    if search.assumption:
        out.print(f"board     {search.assumption}", soft_wrap=True)
    notes = [*search.notes]
    if search.hint:
        notes.append(search.hint)
    elif search.board is not None and not search.found:
        notes.append(board_advice(search.board))
    for note in notes:
        out.print(f"note      {note}", soft_wrap=True)
    if search.field is not None:
        out.print(f"field     {search.field.describe()}", soft_wrap=True)
    out.print(f"detected  {_result(search)}", soft_wrap=True)


def _result(search: Detections) -> str:
    if search.board is None:
        return "no board; specify --pattern or --target"
    kind = "" if isinstance(search.board, Checkerboard) else f"{search.board.kind} "
    corners = sum(len(d) for image in search.images for d in image.boards)
    return f"{kind}{search.board} in {len(search.found)} of {len(search.images)} images, {corners} corners"


def _board(search: Detections, detection: Detection) -> dict[str, Any]:
    field = search.field
    outside = [] if field is None else detection.ids[~field.contains(detection.pixels)].tolist()
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


def _number(value: float, spec: str) -> str:
    return format(value, spec) if math.isfinite(value) else ""
