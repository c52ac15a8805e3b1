"""Output of `omnisight detect`."""

import math

from omnisight.cli._console import console
from omnisight.images.output_paths import image_labels
from omnisight.pipeline.detection.detection_advice import board_advice, light_problems
from omnisight.targets import Checkerboard, Detections


def print_table(search: Detections) -> None:
    """Print one row per image."""
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


def print_report(search: Detections) -> None:
    """Print notes on the set, and the result last."""
    out = console()
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


def _number(value: float, spec: str) -> str:
    return format(value, spec) if math.isfinite(value) else ""
