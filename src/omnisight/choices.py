"""Options whose values are checked: the base class of the options of all commands.

The command line imports such classes for its help, so this module imports nothing heavy.
"""

import dataclasses
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from omnisight.display import Displayed
from omnisight.extensions import unknown_name


class Options(Displayed):
    """A dataclass of options.

    A field whose type is Literal, or Literal or None, accepts only its choices. One of paths accepts strings too.
    """

    def __post_init__(self) -> None:
        """Make paths of strings; raise ValueError if a value is not one of the choices of its field."""
        for name, choices, is_path, is_tuple in _checked_fields(type(self)):
            value = getattr(self, name)
            if is_path:
                object.__setattr__(self, name, _as_paths(value, is_tuple=is_tuple))
            if choices and value is not None and value not in choices:
                raise ValueError(f"--{name.replace('_', '-')}: {unknown_name('choice', value, choices)}")


@cache
def _checked_fields(options: type) -> list[tuple[str, tuple[str, ...], bool, bool]]:
    """Return the name and choices of fields with choices or paths, whether they are paths, and whether several."""
    fields = []
    for field in dataclasses.fields(options):
        choices, is_path = _choices(field.type), Path in (field.type, *get_args(field.type))
        if choices or is_path:
            fields.append((field.name, choices, is_path, get_origin(field.type) is tuple))
    return fields


def _as_paths(value: Any, *, is_tuple: bool) -> Any:
    """Return a string as a path, or one or several as a tuple of paths; other values as they are."""
    if is_tuple:
        several = (value,) if isinstance(value, str | Path) else value
        return tuple(_as_paths(each, is_tuple=False) for each in several)
    return Path(value) if isinstance(value, str) else value


def _choices(kind: Any) -> tuple[str, ...]:
    """Return the choices of a type that is Literal, or Literal or None; none of other types."""
    parts = [kind] if get_origin(kind) is Literal else [part for part in get_args(kind) if part is not NoneType]
    return tuple(choice for part in parts for choice in get_args(part)) if _are_literal(parts) else ()


def _are_literal(kinds: list[Any]) -> bool:
    return all(get_origin(kind) is Literal for kind in kinds)


def check_options(options: object, expected: type) -> None:
    """Raise `ValueError` if options are not of the expected class."""
    if not isinstance(options, expected):
        raise ValueError(f"options must be {expected.__name__}(...), got {type(options).__name__}")
