"""Check of the folders that are written."""

import shutil
import tempfile
from pathlib import Path

from omnisight.diagnosis.finding import Finding, Level
from omnisight.images.output_paths import write_error

PRIORITY = 40

# Free space (bytes) below which images and maps do not fit.
MIN_FREE = 1e9


def check() -> Finding:
    """Check that the current folder and the folder of temporary files can be written."""
    here, temporary = Path.cwd(), Path(tempfile.gettempdir())
    free = shutil.disk_usage(here).free
    figure = f"{here} and {temporary} can be written, {free / 1e9:.0f} GB free"
    for folder in (here, temporary):
        if error := write_error(folder):
            return Finding("permissions", Level.WARNING, f"{folder} {error}", "change to another folder, or its owner")
    if free < MIN_FREE:
        return Finding("permissions", Level.WARNING, figure, "free some space")
    return Finding("permissions", Level.OK, figure)
