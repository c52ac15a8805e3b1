"""A small reader of the YAML, JSON and Python literals that calibration files are written in.

Calibration tools write `%YAML:1.0`, `key:value`, JSON with comments and `.Nan`: a strict parser refuses those on
sight. This one reads maps, lists and scalars, builds nothing else, knows no anchors, and goes through a text once, so
that a hostile file costs no more than its length.
"""

import json
import math
import re
from typing import Any, NamedTuple

LARGEST = 10_000_000  # characters
DEEPEST = 30  # lists and maps inside each other
LONGEST_NUMBER = 60  # characters
INTEGER = re.compile(r"[-+]?\d{1,18}")
REAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
# YAML's, JSON's and Python's; "none" is a word (a distortion of Kalibr).
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
    """Read a text.

    Raises
    ------
    ValueError
        With the line, if it cannot be read.
    """
    if len(text) > LARGEST:
        raise ValueError(f"{len(text)} characters; a calibration has at most {LARGEST}")
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
    """Give a word as int, float, bool, None or, failing these, text: so is what is not finite."""
    token = token.strip()
    if len(token) > LONGEST_NUMBER:
        return token
    if INTEGER.fullmatch(token):
        return int(token)
    if REAL.fullmatch(token):
        value = float(token)
        return value if math.isfinite(value) else token
    return WORDS.get(token, token)


def real(value: float) -> str:
    """Write a number with all its digits, so that YAML 1.1 also takes it for a float: with a point, 1.0e-05."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def flow(value: Any) -> str:
    """Write a value on one line."""
    if isinstance(value, float):
        return real(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(flow, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {flow(v)}" for k, v in value.items()) + "}"
    return json.dumps(value)


class Flow:
    """Values in brackets, and words in quotes."""

    def __init__(self, text: str) -> None:
        self.text = text

    def error(self, at: int, what: str) -> ValueError:
        line = self.text.count("\n", 0, at) + 1
        return ValueError(f"line {line}: {what} {self.text[at : at + 20]!r}")

    def skip(self, at: int) -> int:
        """Pass space and comments."""
        found = SPACE.match(self.text, at)
        return found.end() if found else at

    def value(self, at: int, depth: int) -> tuple[Any, int]:
        """Read the value that begins there; give it and where it ends."""
        if depth > DEEPEST:
            raise self.error(at, f"more than {DEEPEST} brackets inside each other at")
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
            raise self.error(at, "expected a value, found")
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
                raise self.error(at, "expected a name, found")
            name = unquoted(key) if key.re is QUOTED else key.group()
            if name in items:
                raise self.error(at, "a second")
            at = self.skip(key.end())
            if self.text[at : at + 1] != ":":
                raise self.error(at, f"expected a colon after {name!r}, found")
            items[name], at = self.value(self.skip(at + 1), depth + 1)
            at = self._next(at, "}")
        return items, at + 1

    def _next(self, at: int, closing: str) -> int:
        at = self.skip(at)
        if self.text[at : at + 1] == ",":
            return self.skip(at + 1)
        if self.text[at : at + 1] != closing:
            raise self.error(at, f"expected a comma or {closing}, found")
        return at


def unquoted(found: re.Match[str]) -> str:
    double, single = found.groups()
    if double is None:
        return single.replace("''", "'")
    try:
        return json.loads(f'"{double}"', strict=False)
    except ValueError:  # an escape that JSON lacks
        return double


class Line(NamedTuple):
    """A line: how far it is indented, and where in the text its words begin and end."""

    indent: int
    start: int
    end: int


class Block:
    """Maps and lists told by their indentation."""

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
        self.lines.reverse()  # the next line is the last: taken by pop

    def all(self) -> Any:
        if not self.lines:
            raise ValueError("holds nothing but comments")
        value = self.block(self.lines[-1].indent, 0)
        if self.lines:
            raise self.flow.error(self.lines[-1].start, "wrong indentation at")
        return value

    def words(self) -> str:
        return self.text[self.lines[-1].start : self.lines[-1].end]

    def is_item(self) -> bool:
        return self.text[self.lines[-1].start] == "-" and self.words()[1:2] in ("", " ", "\t")

    def block(self, indent: int, depth: int) -> Any:
        """Read the map or list whose lines have this indentation."""
        if depth > DEEPEST:
            raise self.flow.error(self.lines[-1].start, f"more than {DEEPEST} levels at")
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
                raise self.flow.error(line.start, "expected a name and a colon, found")
            name = next(part for part in key.groups() if part is not None).strip()
            if name in items:
                raise self.flow.error(line.start, "a second")
            items[name] = self.value(line, key.end(), depth, dash_level=indent)
        return items

    def value(self, line: Line, at: int, depth: int, dash_level: int | None = None) -> Any:
        """Read what follows a name or a dash: on its line, or below it and farther in.

        A list below a name may stand as far left as the name (`dash_level`).
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
            raise self.flow.error(at, "anchors and texts of several lines are not read:")
        self.lines.pop()
        return scalar(COMMENT.sub("", rest))
