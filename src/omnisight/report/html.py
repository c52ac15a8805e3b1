"""HTML and SVG as text: whatever is not marked up already is escaped, so that no file name can become markup."""

import html
import math
from typing import Any

# Elements that have no content and no end.
VOID = frozenset({"meta", "br"})


class Markup(str):
    """Text that is markup already and is not escaped again."""

    __slots__ = ()


def element(tag: str, *content: Any, **attributes: Any) -> Markup:
    """Give an element of HTML or SVG.

    Parameters
    ----------
    tag
        Its name.
    content
        What it holds, in order: `Markup` as it stands, anything else as text, None not at all.
    attributes
        By name, an underscore for a hyphen and at the end for nothing (`class_`): None and False are left out, True
        is the bare name, a number has as many digits as a drawing needs.
    """
    given = "".join(_attribute(name, value) for name, value in attributes.items())
    if tag in VOID:
        return Markup(f"<{tag}{given}>")
    return Markup(f"<{tag}{given}>{together(*content)}</{tag}>")


def together(*content: Any) -> Markup:
    """Give one thing after the other."""
    return Markup("".join(_escaped(part) for part in content if part is not None))


def short(value: float) -> str:
    """Write a number of a drawing, to a hundredth of its unit."""
    if not math.isfinite(value):
        raise ValueError(f"a drawing needs finite numbers, got {value}")
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _attribute(name: str, value: Any) -> str:
    if value is None or value is False:
        return ""
    name = name.rstrip("_").replace("_", "-")
    if value is True:
        return f" {name}"
    return f' {name}="{html.escape(short(value) if isinstance(value, float) else str(value), quote=True)}"'


def _escaped(part: Any) -> str:
    return part if isinstance(part, Markup) else html.escape(str(part), quote=False)
