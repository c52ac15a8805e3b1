"""Whether files can be written."""

import tempfile
from pathlib import Path


def write_error(folder: Path) -> str:
    """Return why no file can be written into a folder; empty if one can."""
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return f"cannot be written: {error.strerror or error}"
    return ""
