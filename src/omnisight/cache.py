"""The cache folder, for compiled code, detections and frames of clips. What was not used for long is removed."""

import contextlib
import os
import shutil
import sys
import time
from collections.abc import Iterable
from pathlib import Path

# Folders of compiled code have the hash of their sources in their names: `loops-*` and `compiled-*`.
COMPILED = ("loops-*", "compiled-*")
# A version of omnisight has 11 folders of compiled code: those of about six versions are kept.
MAX_COMPILED_FOLDERS = 64
# The last use of a file or folder is its modification time; it is recorded anew after this time, because most commands
# last seconds.
USE_INTERVAL_S = 3600.0
# Prefix of a file or folder that is being removed: a rename takes it away from all processes at once.
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


def frames_folder() -> Path:
    """Return the folder of frames that were extracted from clips."""
    return cache_folder() / "frames"


def compiled_folders() -> list[Path]:
    """Return the folders of compiled code of all versions."""
    return [path for name in COMPILED for path in cache_folder().glob(name)]


def record_use(path: Path) -> None:
    """Record that an entry of the cache folder, or the one that contains a path, is in use."""
    entry = _entry(path)
    if entry is not None:
        touch(entry)


def touch(path: Path) -> None:
    """Record the use of a file or folder, unless it was recorded less than an hour ago."""
    if time.time() - _last_use(path) > USE_INTERVAL_S:
        with contextlib.suppress(OSError):
            os.utime(path)


def remove_old_code() -> None:
    """Remove the compiled code that has not been used for the longest time.

    A process that runs code of a removed folder has it in memory; what it needs later, it compiles again.
    """
    remove_least_recent(compiled_folders(), MAX_COMPILED_FOLDERS)


def remove_least_recent(paths: Iterable[Path], kept: int, unused_s: float = 0.0) -> None:
    """Remove files or folders of a folder, without those that were used last.

    Parameters
    ----------
    paths
        Files or folders in one folder.
    kept
        Number of them that are kept.
    unused_s
        Time without use, s, before which nothing is removed, because a running process can need it.
    """
    recent = sorted(paths, key=_last_use, reverse=True)
    for path in recent[kept:]:
        if time.time() - _last_use(path) >= unused_s:
            with contextlib.suppress(OSError):  # another process removes it too
                path.rename(path.with_name(f"{REMOVED}{os.getpid()}-{path.name}"))
    for parent in {path.parent for path in recent}:
        for path in parent.glob(f"{REMOVED}*"):
            with contextlib.suppress(OSError):
                shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink()


def _entry(path: Path) -> Path | None:
    """Return the entry of the cache folder that is or contains a path; None if it is elsewhere."""
    root = cache_folder()
    return root / path.relative_to(root).parts[0] if root in path.parents else None


def _last_use(path: Path) -> float:
    """Return the time of the last use of a file or folder; 0 if it does not exist."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
