"""Short texts and HTML of results, for the interactive prompt and notebooks.

The options of commands are such dataclasses, so this module imports nothing heavy.
"""

import dataclasses
import importlib
import re
import textwrap
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

from omnisight.extensions import names_in

HTML_PACKAGE = "omnisight.report.notebook"
# Longest text of a value, and most items of a sequence that are shown.
MAX_VALUE_CHARS, MAX_ITEMS = 100, 4
MAX_LINE_CHARS, MAX_LINES = 100, 5


class Displayed:
    """A dataclass with a short text, and HTML with an image if there is a file for it in `report.notebook`.

    The text has the fields that differ from their default, arrays by their shape, on at most five lines.
    """

    def __init_subclass__(cls) -> None:
        """Keep the inherited text: the decorator `dataclass` defines one only if the class has none of its own."""
        super().__init_subclass__()
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__

    def __repr__(self) -> str:
        """Return the fields that differ from their default, on at most five lines."""
        return _text(self, [field.name for field in _shown(self)])

    def _repr_html_(self) -> str | None:
        """Return HTML for notebooks; None if the text is enough."""
        name = next((name for name in map(file_name, type(self).__mro__) if name in names_in(HTML_PACKAGE)), None)
        return None if name is None else importlib.import_module(f"{HTML_PACKAGE}.{name}").html(self)


def rounded(value: float, digits: int = 2) -> str:
    """Format a number rounded to significant digits, without an exponent if it is large: 150 instead of 1.5e+02."""
    return f"{float(f'{value:.{digits}g}'):.15g}"


def file_size(size: int) -> str:
    """Format the size of a file: 98 bytes, 12.3 kB, 1.84 MB."""
    if size < 1000:
        return f"{size} bytes"
    return f"{rounded(size / 1e3, 3)} kB" if size < 1e6 else f"{rounded(size / 1e6, 3)} MB"


def file_name(cls: type) -> str:
    """Return the name of the file for a class, such as relative_pose for RelativePose."""
    return re.sub("(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


def named_tuple_text(self: Any) -> str:
    """Return the short text of a named tuple, as its `__repr__`: a named tuple cannot derive from `Displayed`."""
    return _text(self, self._fields)


def _text(value: Any, names: Sequence[str]) -> str:
    """Return the type of a value and some of its attributes."""
    return shortened(f"{type(value).__name__}({', '.join(f'{name}={_short(getattr(value, name))}' for name in names)})")


def shortened(text: str) -> str:
    """Return a text on at most five lines, the rest of it as an ellipsis."""
    return "\n".join(
        textwrap.wrap(text, MAX_LINE_CHARS, subsequent_indent="    ", max_lines=MAX_LINES, placeholder=" ...)")
    )


def _shown(value: Any) -> list[dataclasses.Field[Any]]:
    """Return the fields with a value that is not the default, and all fields without one."""
    return [field for field in dataclasses.fields(value) if field.repr and not _is_default(field, value)]


def _is_default(field: dataclasses.Field[Any], value: Any) -> bool:
    default: Any = field.default
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    current = getattr(value, field.name)
    if default is dataclasses.MISSING or hasattr(current, "dtype"):
        return False
    try:
        return bool(type(current) is type(default) and current == default)
    except (TypeError, ValueError):  # parts with arrays do not compare
        return False


def _short(value: Any) -> str:
    """Return the text of a value: arrays by their shape, long collections by their length."""
    if hasattr(value, "dtype") and hasattr(value, "shape"):
        return f"<{' x '.join(map(str, value.shape)) or 'scalar'} {value.dtype}>"
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return f"<{len(value)} entries>" if value else "{}"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        items = [_short(item) for item in value[:MAX_ITEMS]] if len(value) <= MAX_ITEMS else []
        text = f"({', '.join(items)})"
        return text if items and len(text) <= MAX_VALUE_CHARS else f"<{len(value)} {_kind(value)}>" if value else "()"
    text = repr(value)
    if "\n" not in text and len(text) <= MAX_VALUE_CHARS:
        return text
    return f"{type(value).__name__}(...)" if dataclasses.is_dataclass(value) else f"{text[:MAX_VALUE_CHARS]}..."


def _kind(values: tuple[Any, ...] | list[Any]) -> str:
    """Return the name of the type of the items."""
    return type(values[0]).__name__
