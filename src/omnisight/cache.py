"""The cache folder, for compiled code and detections."""

import contextlib
import os
import shutil
import sys
import time
from pathlib import Path

# Folders of compiled code have the hash of their sources in their names: `loops-*` and `compiled-*`.
COMPILED = ("loops-*", "compiled-*")
# A version of omnisight has 11 folders of compiled code: those of about six versions are kept.
MAX_COMPILED_FOLDERS = 64
# The last use of a folder is its modification time; it is recorded anew after this time, because most commands last
# seconds.
USE_INTERVAL_S = 3600.0
# Prefix of a folder that is being removed: a rename takes it away from all processes at once.
REMOVED = "removed-"


def cache_folder() -> Path:
    """Return the user's cache folder of omnisight; `OMNISIGHT_CACHE` overrides it. It may not exist yet."""
    if override := os.environ.get("OMNISIGHT_CACHE"):
        return Path(override)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "omnisight" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "omnisight"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "omnisight"


def compiled_folders() -> list[Path]:
    """Return the folders of compiled code of all versions, the last used one first."""
    return sorted((path for name in COMPILED for path in cache_folder().glob(name)), key=_last_use, reverse=True)


def record_use(folder: Path) -> None:
    """Record that a folder of compiled code, or the one that contains it, is in use."""
    entry = _entry(folder)
    if entry is not None and time.time() - _last_use(entry) > USE_INTERVAL_S:
        with contextlib.suppress(OSError):
            os.utime(entry)


def remove_old_code() -> None:
    """Remove the compiled code that has not been used for the longest time.

    A process that runs code of a removed folder has it in memory; what it needs later, it compiles again.
    """
    for folder in compiled_folders()[MAX_COMPILED_FOLDERS:]:
        with contextlib.suppress(OSError):  # another process removes it too
            folder.rename(folder.with_name(f"{REMOVED}{os.getpid()}-{folder.name}"))
    for folder in cache_folder().glob(f"{REMOVED}*"):
        shutil.rmtree(folder, ignore_errors=True)


def _entry(folder: Path) -> Path | None:
    """Return the folder in the cache folder that is or contains a folder; None if it is elsewhere."""
    root = cache_folder()
    return root / folder.relative_to(root).parts[0] if root in folder.parents else None


def _last_use(folder: Path) -> float:
    """Return the time of the last use of a folder; 0 if it does not exist."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0
