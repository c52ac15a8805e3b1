"""Check of the cache folder."""

from pathlib import Path

from omnisight.cache import cache_folder, compiled_folders
from omnisight.diagnosis.finding import Finding, Level
from omnisight.images.output_paths import write_error

PRIORITY = 30

# Size (bytes) above which old entries are worth deleting.
LARGE = 5e9


def check() -> Finding:
    """Check that compiled code and detections can be kept, and how much space they take."""
    folder = cache_folder()
    size, files = _size(folder)
    code = sum(_size(compiled)[0] for compiled in compiled_folders())
    figure = f"{folder}: {files} files, {size / 1e6:.0f} MB, of which {code / 1e6:.0f} MB are compiled code"
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if error := write_error(existing):
        advice = "set OMNISIGHT_CACHE to a folder that can be written: otherwise each run compiles again"
        return Finding("cache", Level.WARNING, f"{figure}; {error}", advice)
    if size > LARGE:
        return Finding("cache", Level.WARNING, figure, "delete the folder to free the space: it is filled again")
    return Finding("cache", Level.OK, figure)


def _size(folder: Path) -> tuple[int, int]:
    """Return the size in bytes and the number of the files of a folder."""
    size = files = 0
    for path in folder.rglob("*") if folder.is_dir() else ():
        try:
            size += path.stat().st_size if path.is_file() else 0
        except OSError:  # another process deletes or replaces files
            continue
        files += 1
    return size, files
