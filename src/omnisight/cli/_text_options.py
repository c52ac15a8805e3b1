"""Options whose text the command line parses: sizes, ranges, lengths and others.

A command derives its options from those of its library function: a field that is typed as a text there is overridden by
one with the `Parameter` of `text_parameter`.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from cyclopts import Parameter, Token

Value = TypeVar("Value")


def text_parameter(parse: Callable[[str, str], Value], show: Callable[[Value], str] = str, **options: Any) -> Parameter:
    """Return the parameter of an option whose text is parsed.

    Parameters
    ----------
    parse
        Function from the text and the name of the option to the value. It raises `ValueError` with the whole message.
    show
        Function from the default to its text in the help.
    **options
        Further properties of the parameter.
    """

    def convert(kind: Any, tokens: Sequence[Token]) -> Value:
        return parse(tokens[0].value, tokens[0].keyword or "")

    return Parameter(
        converter=convert,
        n_tokens=1,
        metavar="STR",
        allow_leading_hyphen=True,
        show_default=lambda value: None if value is None else show(value),
        **options,
    )


def parse_size(text: str, option: str = "--size") -> tuple[int, int]:
    """Parse "1280x720", or "800" for a square."""
    parts = text.lower().replace(",", "x").split("x")
    try:
        sides = [int(part) for part in parts]
    except ValueError:
        sides = []
    if len(sides) == 1:
        sides *= 2
    if len(sides) != 2 or min(sides) < 1:
        raise ValueError(f"{option} must be WIDTHxHEIGHT in px, such as 1280x720, got {text!r}")
    return sides[0], sides[1]


def parse_range(text: str, option: str) -> tuple[float, float]:
    """Parse "-40:30" or "-40,30"."""
    try:
        low, high = (float(part) for part in text.replace(":", ",").split(","))
    except ValueError:
        raise ValueError(f"{option} must be two numbers in degrees, such as {option} -40:30, got {text!r}") from None
    return low, high
