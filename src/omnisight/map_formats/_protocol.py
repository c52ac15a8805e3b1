"""The protocol of a format of remap tables."""

from pathlib import Path
from typing import NamedTuple, Protocol

from omnisight.map_formats._table import RemapTable


class MapFiles(NamedTuple):
    """A remap table in the format of a program.

    Attributes
    ----------
    files
        The files to write and their contents.
    usage
        The command or the code with which the program applies them to an image.
    """

    files: tuple[tuple[Path, bytes], ...]
    usage: str


class MapFormat(Protocol):
    """A format of remap tables: a module of this folder with these names.

    Attributes
    ----------
    TITLE
        The full name.
    PROGRAMS
        Other names, lower case, under which users look for it: those of the programs that read it.
    CONVENTION
        The origin, the unit and the value of pixels that are not covered, in one line.
    """

    TITLE: str
    PROGRAMS: tuple[str, ...]
    CONVENTION: str

    def convert(self, table: RemapTable, output: Path) -> MapFiles:
        """Return the files of a remap table and how they are used.

        Parameters
        ----------
        table
            The source pixel of each pixel of the view.
        output
            The path without an extension, or with one of the format.

        Raises
        ------
        ValueError
            If the program cannot show the view.
        """
        ...
