"""Make a new board to print: its defaults, and its PDF, SVG and JSON files."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from omnisight.images import write_bytes
from omnisight.targets.boards import Board, board_class
from omnisight.targets.boards._aruco import full_name
from omnisight.targets.boards._protocol import parse_pattern, parse_squares
from omnisight.targets.length import format_length, parse_length
from omnisight.targets.printing.drawing import Page
from omnisight.targets.printing.page import lay_out
from omnisight.targets.printing.paper import default_paper
from omnisight.targets.printing.pdf import render_pdf
from omnisight.targets.printing.svg import render_svg
from omnisight.targets.target_file import load_board, save_board


class TargetFiles(NamedTuple):
    """A board on its page, the name of the paper, and the files written."""

    page: Page
    paper: str
    pdf: Path
    svg: Path
    json: Path


def new_board(kind: str, pattern: str | None, values: dict[str, Any]) -> Board:
    """Build a board to print; fields without a value take their defaults.

    Parameters
    ----------
    kind : str
        A name of `board_kinds`.
    pattern : str or None
        Columns x rows, such as 9x6; None if the values contain `squares`, such as 10x7.
    values : dict
        Other fields by name: lengths as text with their unit, such as 24mm, numbers also as text.

    Raises
    ------
    ValueError
        For an unknown kind or field, an unreadable value, or a missing length.
    """
    cls = board_class(kind)
    fields: dict[str, Any] = {**values}
    fields |= _columns_and_rows(cls, pattern, fields.pop("squares", None))
    if "dictionary" in fields:
        fields["dictionary"] = full_name(fields["dictionary"])
    for field in dataclasses.fields(cls):
        factor, base = field.metadata.get("default", (None, None))
        if field.name in fields and field.type is float and not field.metadata.get("length"):
            fields[field.name] = _number(field.name, fields[field.name])
        elif field.name not in fields and base in fields:
            fields[field.name] = format_length(factor * parse_length(fields[base]))
        elif field.name not in fields and factor is not None and base is None:
            fields[field.name] = factor
    for field in dataclasses.fields(cls):
        if field.name not in fields and field.default is dataclasses.MISSING and "default" not in field.metadata:
            raise ValueError(f"the target {kind} needs --{field.name}, a length with its unit, such as 24mm")
    return cls.from_dict(fields)


def write_target(board: Board, output: str | Path | None = None, paper: str | None = None) -> TargetFiles:
    """Write a board as PDF, SVG and JSON, side by side.

    Parameters
    ----------
    board : Board
    output : str or Path, optional
        Name of the PDF; by default kind, pattern and size of the board.
    paper : str, optional
        Name or size of the paper; by default A4, or Letter where it is in use (by LC_PAPER or LANG).

    Raises
    ------
    ValueError
        If the board does not fit on the paper, or a file exists that is not a drawing of omnisight's, or another
        board's.
    """
    paper = paper or default_paper()
    page = lay_out(board, paper)
    size = next((format_length(length) for length in board.lengths().values()), "")
    pdf, svg, json = _output_files(Path(output or f"{board.kind}_{board}_{size}.pdf"), board)
    write_bytes(pdf, render_pdf(page))
    write_bytes(svg, render_svg(page).encode())
    save_board(board, json)
    return TargetFiles(page, paper, pdf, svg, json)


def asymmetric_alternative(board: Board) -> Board | None:
    """Return a board with one row or column more or less that has a unique orientation; None if there is none."""
    steps = ((1, 0), (0, 1), (-1, 0), (0, -1))
    others = [dataclasses.replace(board, columns=board.columns + i, rows=board.rows + j) for i, j in steps]
    return next((other for other in others if not other.is_symmetric), None)


def _columns_and_rows(cls: type[Board], pattern: str | None, squares: str | None) -> dict[str, int]:
    """Return the fields `columns` and `rows` by the pattern or, of a board with squares, by their number."""
    if (pattern is None) == (squares is None):
        advice = ": specify either its pattern or --squares" if pattern else " needs its pattern, such as 9x6"
        raise ValueError(f"the target {cls.kind}{advice}")
    if squares is None:
        return parse_pattern(pattern or "")
    if all(field.name != "square" for field in dataclasses.fields(cls)):
        raise ValueError(f"the target {cls.kind} has no squares: specify its pattern, such as 9x6, not --squares")
    return parse_squares(squares)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--{name} must be a number, such as 0.3, got {text!r}") from None


def _output_files(output: Path, board: Board) -> list[Path]:
    """Return the PDF, SVG and JSON; raise ValueError if one exists that must not be overwritten."""
    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it, such as {output / 'board.pdf'}")
    has_suffix = output.suffix.lower() in (".pdf", ".svg", ".json")
    if not has_suffix and output.suffix[1:].isalpha():
        raise ValueError(f"{output}: the output is a PDF, an SVG and a JSON; name the PDF, {output.stem}.pdf")
    stem = output.stem if has_suffix else output.name
    files = [output.with_name(f"{stem}.{suffix}") for suffix in ("pdf", "svg", "json")]
    advice = "so it is not overwritten; name another file with -o"
    for file, mark in zip(files, (b"/Producer (omnisight)", b"<title>omnisight "), strict=False):
        if file.exists() and not (file.is_file() and mark in file.read_bytes()):
            raise ValueError(f"{file}: exists and was not written by omnisight, {advice}")
    if files[2].exists():
        try:
            existing = load_board(files[2])
        except ValueError:
            raise ValueError(f"{files[2]}: exists and is no target, {advice}") from None
        # A length may have lost its last digits in the file.
        if existing.to_dict() != board.to_dict():
            raise ValueError(f"{files[2]}: exists and describes another board, {advice}")
    return files
