"""Console for tables."""

import sys
from typing import Any

# Columns of a file or pipe, which has no width: wide enough that no table row is cut.
PIPE_COLUMNS = 200


def console() -> Any:
    """Return a console for stdout, as wide as the terminal."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else PIPE_COLUMNS)
