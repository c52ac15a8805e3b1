"""Read the YAML, JSON and Python literals that calibration files are written in.

Calibration tools write `%YAML:1.0`, `key:value`, JSON with comments and `.Nan`, which strict parsers refuse. This
reader supports maps, lists and scalars, no anchors, and reads a text once: a hostile file costs no more than
its length.
"""

import json
import math
import re
from typing import Any, NamedTuple

from omnisight.formats._limits import MAX_DEPTH, MAX_TEXT_CHARS

MAX_NUMBER_CHARS = 60  # converting digits takes quadratic time
INTEGER = re.compile(r"[-+]?\d{1,18}")
REAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
# Of YAML, JSON and Python; "none" stays a text, because it is a distortion model of Kalibr.
WORDS = {"true": True, "True": True, "false": False, "False": False, "null": None, "None": None, "~": None, "": None}
SPACE = re.compile(r"\s*(?:(?:#|//)[^\n]*\s*)*")
QUOTED = re.compile(r"""b?(?:"((?:[^"\\]|\\.)*)"|'((?:[^'\\]|\\.|'')*)')""", re.DOTALL)
PLAIN = re.compile(r"[^,\[\]{}\n]+")
FLOW_KEY = re.compile(r"[^\s:,\[\]{}\"']+")
BLOCK_KEY = re.compile(r"""(?:"([^"\n]*)"[ \t]*|'([^'\n]*)'[ \t]*|([^\s\-"'\[\]{},#&*!|>%@`:][^:\n#]*)):""")
ITEM_KEY = re.compile(r"""["']?[A-Za-z_][\w.\-]*["']?[ \t]*:(?:\s|$)""")
TAG = re.compile(r"!\S*[ \t]*")
COMMENT = re.compile(r"(?:^|\s)#.*")


def read(text: str) -> Any:
    """Read a text; raise ValueError with the line if that fails."""
    if len(text) > MAX_TEXT_CHARS:
        raise ValueError(f"{len(text)} characters; at most {MAX_TEXT_CHARS} are read")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    flow = Flow(text)
    start = flow.skip(0)
    if text[start : start + 1] in ("{", "["):
        value, end = flow.value(start, 0)
        if flow.skip(end) < len(text):
            raise flow.error(end, "unexpected")
        return value
    return Block(text).all()


def read_map(text: str) -> dict[str, Any]:
    """Read a text that must hold a map."""
    value = read(text)
    if not isinstance(value, dict):
        raise ValueError(f"must hold names and values, got a {type(value).__name__}")
    return value


def scalar(token: str) -> Any:
    """Convert a token to int, float, bool or None; anything else, such as a number that is not finite, stays a text."""
    token = token.strip()
    if len(token) > MAX_NUMBER_CHARS:
        return token
    if INTEGER.fullmatch(token):
        return int(token)
    if REAL.fullmatch(token):
        value = float(token)
        return value if math.isfinite(value) else token
    return WORDS.get(token, token)


def real(value: float) -> str:
    """Return a number with all its digits and a decimal point, which YAML 1.1 needs to read 1.0e-05 as a float."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def flow(value: Any) -> str:
    """Return a value as YAML on one line."""
    if isinstance(value, float):
        return real(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {flow(v)}" for k, v in value.items()) + "}"
    return json.dumps(value)


class Flow:
    """Reader of values in brackets and quotes."""

    def __init__(self, text: str) -> None:
        self.text = text

    def error(self, at: int, what: str) -> ValueError:
        """Return an error that names the line of an offset."""
        line = self.text.count("\n", 0, at) + 1
        return ValueError(f"line {line}: {what} {self.text[at : at + 20]!r}")

    def skip(self, at: int) -> int:
        """Return the offset after white space and comments."""
        found = SPACE.match(self.text, at)
        return found.end() if found else at

    def value(self, at: int, depth: int) -> tuple[Any, int]:
        """Return the value at an offset and the offset of its end."""
        if depth > MAX_DEPTH:
            raise self.error(at, f"more than {MAX_DEPTH} nested brackets at")
        head = self.text[at : at + 1]
        if head == "!":
            found = TAG.match(self.text, at)
            return self.value(self.skip(found.end() if found else at), depth + 1)
        if head == "[":
            return self._list(at, depth)
        if head == "{":
            return self._map(at, depth)
        if quoted := QUOTED.match(self.text, at):
            return unquoted(quoted), quoted.end()
        plain = PLAIN.match(self.text, at)
        if not plain or head in ("&", "*"):
            raise self.error(at, "expected a value, got")
        return scalar(COMMENT.sub("", plain.group())), plain.end()

    def _list(self, at: int, depth: int) -> tuple[list[Any], int]:
        items: list[Any] = []
        at = self.skip(at + 1)
        while self.text[at : at + 1] != "]":
            item, at = self.value(at, depth + 1)
            items.append(item)
            at = self._next(at, "]")
        return items, at + 1

    def _map(self, at: int, depth: int) -> tuple[dict[str, Any], int]:
        items: dict[str, Any] = {}
        at = self.skip(at + 1)
        while self.text[at : at + 1] != "}":
            key = QUOTED.match(self.text, at) or FLOW_KEY.match(self.text, at)
            if not key:
                raise self.error(at, "expected a name, got")
            name = unquoted(key) if key.re is QUOTED else key.group()
            if name in items:
                raise self.error(at, "duplicate")
            at = self.skip(key.end())
            if self.text[at : at + 1] != ":":
                raise self.error(at, f"expected a colon after {name!r}, got")
            items[name], at = self.value(self.skip(at + 1), depth + 1)
            at = self._next(at, "}")
        return items, at + 1

    def _next(self, at: int, closing: str) -> int:
        at = self.skip(at)
        if self.text[at : at + 1] == ",":
            return self.skip(at + 1)
        if self.text[at : at + 1] != closing:
            raise self.error(at, f"expected a comma or {closing}, got")
        return at


def unquoted(match: re.Match[str]) -> str:
    """Return the text of a match of `QUOTED`."""
    double, single = match.groups()
    if double is None:
        return single.replace("''", "'")
    try:
        return json.loads(f'"{double}"', strict=False)
    except ValueError:  # an escape that JSON lacks
        return double


class Line(NamedTuple):
    """A line: its indentation, and the offsets of its first and last character."""

    indent: int
    start: int
    end: int


class Block:
    """Reader of maps and lists that are nested by indentation."""

    def __init__(self, text: str) -> None:
        self.text, self.flow = text, Flow(text)
        self.lines: list[Line] = []
        start = 0
        for raw in text.split("\n"):
            words = raw.strip()
            if words and not words.startswith(("#", "%", "---", "...")):
                lead = raw[: len(raw) - len(raw.lstrip())]
                self.lines.append(Line(len(lead.expandtabs()), start + len(lead), start + len(raw.rstrip())))
            start += len(raw) + 1
        self.lines.reverse()  # `pop` returns the next line

    def all(self) -> Any:
        """Return the value of the whole text."""
        if not self.lines:
            raise ValueError("holds only comments")
        value = self.block(self.lines[-1].indent, 0)
        if self.lines:
            raise self.flow.error(self.lines[-1].start, "wrong indentation at")
        return value

    def words(self) -> str:
        """Return the text of the next line."""
        return self.text[self.lines[-1].start : self.lines[-1].end]

    def is_item(self) -> bool:
        """Return whether the next line is an item of a list."""
        return self.text[self.lines[-1].start] == "-" and self.words()[1:2] in ("", " ", "\t")

    def block(self, indent: int, depth: int) -> Any:
        """Return the map or list whose lines have this indentation."""
        if depth > MAX_DEPTH:
            raise self.flow.error(self.lines[-1].start, f"more than {MAX_DEPTH} nested levels at")
        if self.words()[0] in "[{":
            return self.value(self.lines[-1], self.lines[-1].start, depth)
        return self._list(indent, depth) if self.is_item() else self._map(indent, depth)

    def _list(self, indent: int, depth: int) -> list[Any]:
        items: list[Any] = []
        while self.lines and self.lines[-1].indent == indent and self.is_item():
            line = self.lines[-1]
            start = line.start + 1 + len(self.words()[1:]) - len(self.words()[1:].lstrip())
            inner = Line(indent + start - line.start, start, line.end)
            rest = self.text[start : line.end]
            if ITEM_KEY.match(rest) or rest[:2] in ("-", "- "):
                self.lines[-1] = inner
                items.append(self.block(inner.indent, depth + 1))
            else:
                items.append(self.value(line, start, depth))
        return items

    def _map(self, indent: int, depth: int) -> dict[str, Any]:
        items: dict[str, Any] = {}
        while self.lines and self.lines[-1].indent == indent and not self.is_item():
            line = self.lines[-1]
            key = BLOCK_KEY.match(self.text, line.start, line.end)
            if not key:
                raise self.flow.error(line.start, "expected a name and a colon, got")
            name = next(part for part in key.groups() if part is not None).strip()
            if name in items:
                raise self.flow.error(line.start, "duplicate")
            items[name] = self.value(line, key.end(), depth, dash_level=indent)
        return items

    def value(self, line: Line, at: int, depth: int, dash_level: int | None = None) -> Any:
        """Return the value after a name or a dash, on its line or indented below it.

        A list below a name may have the indentation of the name (`dash_level`).
        """
        rest = self.text[at : line.end]
        at += len(rest) - len(rest.lstrip())
        if self.text[at : at + 1] == "!" and at < line.end:
            tag = TAG.match(self.text, at, line.end)
            at = tag.end() if tag else at
        rest = self.text[at : line.end]
        if not rest or rest.startswith("#"):
            self.lines.pop()
            if self.lines and (
                self.lines[-1].indent > line.indent or (self.lines[-1].indent == dash_level and self.is_item())
            ):
                return self.block(self.lines[-1].indent, depth + 1)
            return None
        if rest[0] in "[{" or QUOTED.match(self.text, at):
            value, end = self.flow.value(at, depth)
            while self.lines and self.lines[-1].start < end:
                last = self.lines.pop()
                if last.end > end and COMMENT.sub("", self.text[end : last.end]).strip():
                    raise self.flow.error(end, "unexpected")
            return value
        if rest[0] in "&*|>":
            raise self.flow.error(at, "anchors and multi-line texts are not supported:")
        self.lines.pop()
        return scalar(COMMENT.sub("", rest))
