"""Output files of a command."""

import tempfile
from pathlib import Path


def must_be_writable(output: Path) -> None:
    """Raise before any work if an output file cannot be written."""
    if output.is_dir():
        raise ValueError(f"{output}: is a folder; name a file in it, such as {output / 'camera.json'}")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder {output.parent}; make it first")
    try:
        tempfile.TemporaryFile(dir=output.parent).close()
    except OSError as error:
        raise ValueError(f"{output}: cannot be written: {error.strerror} ({output.parent})") from error
