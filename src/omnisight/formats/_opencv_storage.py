"""Reading OpenCV's FileStorage: its YAML, XML and JSON.

Not by `cv2.FileStorage`, which answers a damaged file with a message on the terminal or a crash in native code; the
files come from anywhere, and what is needed of them is small.
"""

from typing import Any
from xml.etree import ElementTree

from omnisight.formats._yaml import DEEPEST, LARGEST, read_map, scalar

NOT_FINITE = (".N", ".I", "-.", "+.")  # .Nan, -.Inf


def read_storage(text: str) -> dict[str, Any]:
    """Give what a file holds by name; matrices as maps with rows, cols and data."""
    if not text.lstrip().startswith("<"):
        return read_map(text)
    root = read_xml(text, _Storage())
    if not isinstance(root, dict):
        raise ValueError("the XML holds no names")
    return root


def read_xml(text: str, target: Any) -> Any:
    """Give what a target (`start`, `data`, `end`, `close`) makes of a text's elements; bounded, without entities."""
    if len(text) > LARGEST:
        raise ValueError(f"{len(text)} characters; a calibration has at most {LARGEST}")
    if "<!" in text.replace("<!--", ""):
        # Entities defined in a file may grow without bound.
        raise ValueError("the XML has a declaration (<!DOCTYPE or alike), which no calibration needs")
    # The text is decoded already, and a declared encoding would contradict that.
    parser = ElementTree.XMLParser(target=target, encoding="utf-8")
    try:
        parser.feed(text.encode("utf-8", errors="replace"))
        return parser.close()
    except ElementTree.ParseError as error:
        raise ValueError(f"damaged XML: {error}") from error


class _Storage:
    """What the parser calls: makes maps, lists and words of nested elements."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.children: list[list[tuple[str, Any]]] = [[]]
        self.words: list[list[str]] = [[]]

    def start(self, tag: str, _: dict[str, str]) -> None:
        if len(self.names) > DEEPEST:
            raise ValueError(f"more than {DEEPEST} elements inside each other")
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
        raise ValueError(f"a second {next(n for n in names if names.count(n) > 1)!r}")
    return dict(children)
