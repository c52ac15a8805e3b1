"""The console on which tables are printed."""

import sys
from typing import Any

# Width in columns if stdout is a file or a pipe, so that no row of a table is cut.
PIPE_COLUMNS = 200


def console() -> Any:
    """Return a console for stdout with the width of the terminal."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else PIPE_COLUMNS)
