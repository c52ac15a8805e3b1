"""Read OpenCV's FileStorage: YAML, XML and JSON.

`cv2.FileStorage` answers a damaged file with a message on the terminal or a crash in native code.
"""

from typing import Any
from xml.etree import ElementTree

from omnisight.formats._limits import MAX_DEPTH, MAX_TEXT_CHARS
from omnisight.formats._yaml import read_map, scalar

NOT_FINITE = (".N", ".I", "-.", "+.")  # .Nan, -.Inf


def read_storage(text: str) -> dict[str, Any]:
    """Return the values of a file by name; a matrix is a map with rows, cols and data."""
    if not text.lstrip().startswith("<"):
        return read_map(text)
    root = read_xml(text, _Storage())
    if not isinstance(root, dict):
        raise ValueError("the XML holds no named values")
    return root


def read_xml(text: str, target: Any) -> Any:
    """Return what a target (`start`, `data`, `end`, `close`) builds from the elements of a text without entities."""
    if len(text) > MAX_TEXT_CHARS:
        raise ValueError(f"{len(text)} characters; at most {MAX_TEXT_CHARS} are read")
    if "<!" in text.replace("<!--", ""):
        # Entities that a file defines may expand without bound.
        raise ValueError("the XML has a declaration (<!DOCTYPE or alike), which no calibration needs")
    # The text is already decoded; an encoding that it declares must not apply.
    parser = ElementTree.XMLParser(target=target, encoding="utf-8")
    try:
        parser.feed(text.encode("utf-8", errors="replace"))
        return parser.close()
    except ElementTree.ParseError as error:
        raise ValueError(f"damaged XML: {error}") from error


class _Storage:
    """A target of the XML parser that builds maps, lists and scalars from nested elements."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.children: list[list[tuple[str, Any]]] = [[]]
        self.words: list[list[str]] = [[]]

    def start(self, tag: str, _: dict[str, str]) -> None:
        if len(self.names) > MAX_DEPTH:
            raise ValueError(f"more than {MAX_DEPTH} nested elements")
        self.names.append(tag)
        self.children.append([])
        self.words.append([])

    def data(self, text: str) -> None:
        self.words[-1].append(text)

    def end(self, _: str) -> None:
        name, children, text = self.names.pop(), self.children.pop(), "".join(self.words.pop()).strip()
        self.children[-1].append((name, _value(children, text)))

    def close(self) -> Any:
        return self.children[0][0][1] if self.children[0] else None


def _value(children: list[tuple[str, Any]], text: str) -> Any:
    """Return the value of an element with these children and this text."""
    if not children:
        if text.startswith('"'):
            return text.strip('"')
        words = [scalar(word) for word in text.split()]
        if len(words) == 1:
            return words[0]
        return words if all(isinstance(word, int | float) or str(word)[:2] in NOT_FINITE for word in words) else text
    names = [name for name, _ in children]
    if set(names) == {"_"}:
        return [*map(scalar, text.split()), *(value for _, value in children)]
    if len(set(names)) < len(names):
        raise ValueError(f"duplicate {next(n for n in names if names.count(n) > 1)!r}")
    return dict(children)
