"""The cache folder, for compiled code and detections."""

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return the user's cache folder of omnisight; `OMNISIGHT_CACHE` overrides it. It may not exist yet."""
    if override := os.environ.get("OMNISIGHT_CACHE"):
        return Path(override)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "omnisight" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "omnisight"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "omnisight"
