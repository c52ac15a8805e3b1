"""Files of several cameras that an option specifies by name. This module imports nothing heavy."""

from collections.abc import Iterable
from pathlib import Path


def named_files(entries: Iterable[str]) -> dict[str, Path]:
    """Return the files of `--camera NAME=FILE` by the name of the camera.

    Raises
    ------
    ValueError
        If an entry is not NAME=FILE, or a name occurs twice.
    """
    files: dict[str, Path] = {}
    for entry in entries:
        name, is_pair, file = entry.partition("=")
        if not is_pair or not name or not file:
            raise ValueError(f"--camera {entry}: must be NAME=FILE, such as front=front.json")
        if name in files:
            raise ValueError(f"--camera {entry}: there are two files for the camera {name}")
        files[name] = Path(file)
    return files
