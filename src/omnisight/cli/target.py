"""omnisight target."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter


def target(
    action: Literal["make"],
    kind: str,
    pattern: str,
    /,
    *,
    square: str | None = None,
    marker: str | None = None,
    dictionary: str | None = None,
    legacy: bool = False,
    tag: str | None = None,
    spacing: str | None = None,
    diameter: str | None = None,
    paper: str | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
) -> None:
    """Make a board to print, true to size: a PDF, an SVG, and the JSON that describes it.

    Say the kind of the board, its pattern, and how large it is:

        omnisight target make checkerboard 9x6 --square 24mm
        omnisight target make charuco 9x6 --square 30mm --paper A3 -o board.pdf
        omnisight target make aprilgrid 6x6 --tag 24mm
        omnisight target make circles 4x11 --spacing 18mm

    Parameters
    ----------
    action
        make.
    kind
        checkerboard, charuco, aprilgrid or circles.
    pattern
        Columns x rows: inner corners of a checkerboard or charuco (10x7 squares have 9x6), tags, circles.
    square
        Side of a square with its unit: 30mm.
    marker
        charuco: side of a marker; three quarters of the square if absent.
    dictionary
        charuco: OpenCV's name of the markers' dictionary, such as 4x4_50; DICT_5X5_100 if absent.
    legacy
        charuco: laid out as OpenCV before 4.6 did.
    tag
        aprilgrid: side of a tag with its black border.
    spacing
        aprilgrid: gap between tags over a tag's side, 0.3 if absent. circles: distance of a row from
        the next with its unit, such as 18mm.
    diameter
        circles: of one of them; as the spacing if absent.
    paper
        A0 to A5, Letter, Legal, Tabloid, or a size such as 600x400mm; the smallest of A4 to A0 that fits if absent.
    output
        The PDF to write; SVG and JSON go beside it. Named after the board and its size if absent. Nothing is
        written over but drawings of omnisight's, and the JSON of the same board.
    """
    from omnisight.images import write_bytes
    from omnisight.targets.printing.page import lay_out, smallest_paper
    from omnisight.targets.printing.paper import millimetres
    from omnisight.targets.printing.pdf import render_pdf
    from omnisight.targets.printing.svg import render_svg
    from omnisight.targets.target_file import save_board

    asked = {"square": square, "marker": marker, "dictionary": dictionary, "legacy": legacy or None, "tag": tag}
    asked |= {"spacing": spacing, "diameter": diameter}
    board = _board(kind, pattern, {name: value for name, value in asked.items() if value is not None})
    paper = paper or smallest_paper(board)
    page = lay_out(board, paper)
    pdf, svg, json = _files(output or Path(f"{kind}_{board}_{_size(board)}.pdf"), board)
    write_bytes(pdf, render_pdf(page))
    write_bytes(svg, render_svg(page).encode())
    save_board(board, json)
    left, top, right, bottom = board.extent
    ruler = next(text.words for text in page.texts if "measure" in text.words)
    print(f"board    {kind} {board}, {board.size} points, {millimetres(right - left, bottom - top)}")
    print(f"paper    {paper}, {millimetres(page.width, page.height)}")
    print(f"written  {pdf}, {svg.name}, {json.name}")
    print(f"print    {ruler.removeprefix('Print ')} Measure the board as well, and glue it to something flat")
    print(f"then     omnisight calibrate images/ --target {json}")
    if board.is_symmetric:
        print(f"note     {_symmetry(board)}")


def _board(kind: str, pattern: str, asked: dict[str, Any]) -> Any:
    """Build the board from what was asked for, and what is usual."""
    from omnisight.targets.boards import board_class
    from omnisight.targets.boards._aruco import full_name
    from omnisight.targets.boards._protocol import parse_pattern
    from omnisight.targets.length import format_length, parse_length

    cls = board_class(kind)
    values: dict[str, Any] = {**parse_pattern(pattern), **asked}
    if "dictionary" in values:
        values["dictionary"] = full_name(values["dictionary"])
    for field in dataclasses.fields(cls):
        share, of = field.metadata.get("default", (None, None))
        if field.name in values and field.type == "float" and not field.metadata.get("length"):
            values[field.name] = _number(field.name, values[field.name])
        elif field.name not in values and of in values:
            values[field.name] = format_length(share * parse_length(values[of]))
        elif field.name not in values and share is not None and of is None:
            values[field.name] = share
    for field in dataclasses.fields(cls):
        if field.name not in values and field.default is dataclasses.MISSING and "default" not in field.metadata:
            raise ValueError(f"the target {kind} needs --{field.name}, a length with its unit, such as 24mm")
    return cls.from_dict(values)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--{name} must be a number, such as 0.3, got {text!r}") from None


def _size(board: Any) -> str:
    """Give the first of a board's lengths, 24mm: the side of a square or of a tag, or the spacing."""
    from omnisight.targets.length import format_length

    return next((format_length(length) for length in board.lengths().values()), "")


def _files(output: Path, board: Any) -> list[Path]:
    """Give the PDF, the SVG and the JSON; refuse to write over what is not a drawing of ours, or another board."""
    from omnisight.targets.target_file import load_board

    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it, such as {output / 'board.pdf'}")
    written = output.suffix.lower() in (".pdf", ".svg", ".json")
    if not written and output.suffix[1:].isalpha():
        raise ValueError(f"{output}: what is written is a PDF, an SVG and a JSON; name the PDF, {output.stem}.pdf")
    stem = output.stem if written else output.name
    files = [output.with_name(f"{stem}.{suffix}") for suffix in ("pdf", "svg", "json")]
    instead = "so it is kept; name another file with -o"
    for file, ours in zip(files, (b"/Producer (omnisight)", b"<title>omnisight "), strict=False):
        if file.exists() and not (file.is_file() and ours in file.read_bytes()):
            raise ValueError(f"{file}: is there and was not written by omnisight, {instead}")
    if files[2].exists():
        try:
            there = load_board(files[2])
        except ValueError:
            raise ValueError(f"{files[2]}: is there and is no target, {instead}") from None
        # A length may have lost its last digits in the file.
        if there.to_dict() != board.to_dict():
            raise ValueError(f"{files[2]}: is there and describes another board, {instead}")
    return files


def _symmetry(board: Any) -> str:
    """Say what a symmetric board lacks, and the nearest that has it."""
    near = ((1, 0), (0, 1), (-1, 0), (0, -1))
    others = [dataclasses.replace(board, columns=board.columns + i, rows=board.rows + j) for i, j in near]
    better = next(str(other) for other in others if not other.is_symmetric)
    return (
        f"{board.kind} {board} looks the same upside-down"
        f"{', and its corners after every quarter turn' if board.columns == board.rows else ''}: one camera can be"
        f" calibrated with it, but two cannot agree which way up it is. {better} can tell"
    )
