"""Where tables go."""

import sys
from typing import Any

WIDE = 200  # columns, where no terminal says how many there are: a file or a pipe


def console() -> Any:
    """Give a console for stdout: as wide as the terminal, or so wide that no row of a table is cut."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else WIDE)
