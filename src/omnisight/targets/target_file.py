"""Target files: omnisight's JSON, and the YAML of Kalibr."""

import json
import re
import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omnisight.extensions import file_error
from omnisight.images import write_bytes
from omnisight.targets.boards import Board, board_class, board_kinds
from omnisight.targets.boards._protocol import MAX_TEXT_LENGTH
from omnisight.targets.length import format_length

# A target file has a few lines.
MAX_BYTES = 1_000_000

LINE = re.compile(r"([A-Za-z_]\w{0,40})[ \t]*:(?:[ \t]+|(?=['\"])|$)(.*)")
QUOTED = re.compile(r"'([^']*)'|\"([^\"]*)\"")
INTEGER = re.compile(r"[-+]?\d{1,18}")
REAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

# Names of the number of an aprilgrid's first tag in Kalibr's files; 0 if absent.
FIRST_TAG = ("low_id", "codeOffset")


def load_board(path: str | Path) -> Board:
    """Read a board: `{"target": "checkerboard", "columns": 9, "rows": 6, "square": "30mm"}`, or Kalibr's target YAML.

    Nothing in the file is executed. Basalt's JSON, which has Kalibr's names, is read as well.

    Raises
    ------
    ValueError
        If the file cannot be read or describes no board, with the file, the field, its value, and what was expected.
    """
    try:
        return _board(_text(Path(path)))
    except RecursionError:
        raise ValueError(f"{path}: brackets are nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def save_board(board: Board, path: str | Path) -> None:
    """Write a board as JSON, atomically.

    Raises
    ------
    OSError
        If the folder is missing or not writable.
    """
    write_bytes(path, (json.dumps(board.to_dict()) + "\n").encode())


def _text(path: Path) -> str:
    try:
        if path.is_dir():
            raise ValueError("is a folder, not a target file")
        if path.exists() and not path.is_file():
            raise ValueError("is a pipe or a device; a target file must be a regular file")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ValueError(file_error(path, error)) from None
    if len(data) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES} bytes; a target file has a few lines")
    if data.lstrip().startswith((b"%PDF-", b"<")):
        raise ValueError(f"is the print of a board: specify the file that describes it, {path.with_suffix('.json')}")
    # PowerShell's `>` writes UTF-16.
    text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", errors="replace").strip()
    if not text:
        raise ValueError("empty file")
    return text


def _board(text: str) -> Board:
    if not text.startswith("{"):
        return _from_kalibr(_flat_yaml(text))
    try:
        values: dict[str, Any] = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno} is not JSON: {error.msg}") from None
    if "target" not in values and ("tagCols" in values or "target_type" in values):
        return _from_kalibr({"target_type": "aprilgrid", **values})
    kind = values.get("target")
    if not isinstance(kind, str) or kind not in board_kinds():
        found = f"target is {reprlib.repr(kind)}" if "target" in values else "target is missing"
        raise ValueError(f"{found}: expected one of {', '.join(board_kinds())}")
    return board_class(kind).from_dict(values)


def _flat_yaml(text: str) -> dict[str, Any]:
    """Parse lines `name: value # comment`: all that Kalibr's target files contain."""
    values: dict[str, Any] = {}
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.strip()
        if not bare or bare.startswith(("#", "---", "%")):
            continue
        match = LINE.fullmatch(bare[: MAX_TEXT_LENGTH * 10])
        if match is None:
            raise ValueError(
                f"line {number} is {reprlib.repr(bare)}: expected JSON, or lines of Kalibr's YAML such as tagCols: 6"
            )
        values[match[1]] = _scalar(match[2].strip())
    return values


def _scalar(text: str) -> Any:
    if quoted := QUOTED.match(text):
        return quoted[1] if quoted[1] is not None else quoted[2]
    word = re.split(r"(?:^|[ \t])#", text, maxsplit=1)[0].strip()
    if len(word) <= MAX_TEXT_LENGTH and INTEGER.fullmatch(word):
        return int(word)
    if len(word) <= MAX_TEXT_LENGTH and REAL.fullmatch(word):
        return float(word)
    return {"true": True, "True": True, "false": False, "False": False}.get(word, word)


def _from_kalibr(values: dict[str, Any]) -> Board:
    kind = values.pop("target_type", None)
    readers: dict[str, Callable[[_Fields], dict[str, Any]]] = {
        "aprilgrid": _aprilgrid,
        "checkerboard": _checkerboard,
        "circlegrid": _circlegrid,
    }
    if not isinstance(kind, str) or kind not in readers:
        found = "target_type is missing" if kind is None else f"target_type is {reprlib.repr(kind)}"
        raise ValueError(f"{found}: expected JSON with a target, or a target of Kalibr: {', '.join(readers)}")
    fields = _Fields(values)
    board = readers[kind](fields)
    if fields.unread:
        raise ValueError(
            f"Kalibr's {kind} has no {', '.join(map(reprlib.repr, fields.unread))}; remove it if the board is right"
            " without it"
        )
    return board_class(board["target"]).from_dict(board)


class _Fields:
    """Fields of a Kalibr file, each taken once."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.unread = dict(values)

    def take(self, name: str) -> Any:
        if name not in self.unread:
            raise ValueError(f"{name} is missing")
        return self.unread.pop(name)

    def number(self, name: str) -> float:
        value = self.take(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e6:
            raise ValueError(f"{name} is {reprlib.repr(value)}: expected a positive number")
        return value

    def count(self, name: str) -> int:
        value = self.number(name)
        if not isinstance(value, int):
            raise ValueError(f"{name} is {value!r}: expected an integer")
        return value

    def length(self, name: str) -> str:
        return format_length(self.number(name))


def _aprilgrid(kalibr: _Fields) -> dict[str, Any]:
    return {
        "target": "aprilgrid",
        "columns": kalibr.count("tagCols"),
        "rows": kalibr.count("tagRows"),
        "tag": kalibr.length("tagSize"),
        "spacing": kalibr.number("tagSpacing"),
        "first_marker": next((kalibr.take(name) for name in FIRST_TAG if name in kalibr.unread), 0),
    }


def _checkerboard(kalibr: _Fields) -> dict[str, Any]:
    counts = {"columns": kalibr.count("targetCols"), "rows": kalibr.count("targetRows")}
    across, down = kalibr.number("colSpacingMeters"), kalibr.number("rowSpacingMeters")
    if abs(across - down) > 1e-6 * across:
        raise ValueError(
            f"colSpacingMeters is {across:g} and rowSpacingMeters {down:g}: a checkerboard has squares, so these"
            " must be equal"
        )
    return {"target": "checkerboard", **counts, "square": format_length(across)}


def _circlegrid(kalibr: _Fields) -> dict[str, Any]:
    if not isinstance(asymmetric := kalibr.take("asymmetricGrid"), bool):
        raise ValueError(f"asymmetricGrid is {reprlib.repr(asymmetric)}: expected true or false")
    return {
        "target": "circles" if asymmetric else "symmetric_circles",
        "columns": kalibr.count("targetCols"),
        "rows": kalibr.count("targetRows"),
        "spacing": kalibr.length("spacingMeters"),
    }
