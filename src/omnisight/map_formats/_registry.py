"""The formats of remap tables by name."""

from typing import cast

from omnisight.extensions import module_in, names_in, unknown_name
from omnisight.map_formats._protocol import MapFormat

PACKAGE = "omnisight.map_formats"


def map_format_names() -> tuple[str, ...]:
    """Return the names of all formats, sorted: the names of the files in this folder, with hyphens."""
    return tuple(name.replace("_", "-") for name in names_in(PACKAGE))


def get_map_format(name: str) -> MapFormat:
    """Return the format of this name; raise ValueError with the known names if there is none."""
    if name not in map_format_names():
        raise ValueError(unknown_name("format of remap tables", name, map_format_names()))
    return cast(MapFormat, module_in(PACKAGE, name.replace("-", "_"), "format of remap tables"))


def format_of_program(program: str) -> str | None:
    """Return the format that a program reads, or None if that is not known."""
    formats = map_format_names()
    return next((name for name in formats if program.lower() in get_map_format(name).PROGRAMS), None)
