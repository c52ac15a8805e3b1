"""HTML and SVG elements as text. Everything that is not `Markup` is escaped, so file names cannot inject markup."""

import html
import math
from pathlib import Path
from typing import Any

from omnisight.images import write_bytes

# Elements without content and end tag.
VOID_ELEMENTS = frozenset({"meta", "br", "input"})


class Markup(str):
    """Text that is already markup and is not escaped again."""

    __slots__ = ()


def element(tag: str, *content: Any, **attributes: Any) -> Markup:
    """Return an HTML or SVG element.

    Parameters
    ----------
    tag
        Name of the element.
    content
        Children in order: `Markup` is inserted as it is, None is skipped, anything else is escaped text.
    attributes
        Attributes by name, with an underscore for a hyphen; a trailing underscore is removed (`class_`). None and
        False are skipped, True becomes a bare name, and a float is rounded to two decimals.
    """
    start = tag + "".join(_attribute(name, value) for name, value in attributes.items())
    return Markup(f"<{start}>") if tag in VOID_ELEMENTS else Markup(f"<{start}>{join(*content)}</{tag}>")


def join(*content: Any) -> Markup:
    """Concatenate `Markup` and escaped text; skip None."""
    return Markup("".join(_escape(part) for part in content if part is not None))


def format_coordinate(value: float) -> str:
    """Format a coordinate of a drawing with at most two decimals; raise `ValueError` if it is not finite."""
    if not math.isfinite(value):
        raise ValueError(f"expected a finite coordinate, got {value}")
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def table(columns: tuple[str, ...], rows: list[Markup], *, caption: str | None = None, class_: str = "") -> Markup:
    """Return a table of rows (tr elements) that scrolls horizontally on narrow screens."""
    content = element(
        "table",
        element("caption", caption) if caption else None,
        element("thead", element("tr", *(element("th", column, scope="col") for column in columns))),
        element("tbody", *rows),
        class_=class_ or None,
    )
    return element("div", content, class_="scroll")


def write_html(path: str | Path, text: str) -> None:
    """Write a page atomically.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    # File names that are not valid UTF-8 contain lone surrogates.
    write_bytes(path, text.encode("utf-8", "replace"))


def _attribute(name: str, value: Any) -> str:
    if value is None or value is False:
        return ""
    name = name.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    text = format_coordinate(value) if isinstance(value, float) else str(value)
    return f' {name}="{html.escape(text, quote=True)}"'


def _escape(part: Any) -> str:
    return part if isinstance(part, Markup) else html.escape(str(part), quote=False)
