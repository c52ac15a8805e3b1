"""Cache of detections, keyed by the content of the image file.

There is one small JSON file per image in the user's cache folder. The key covers the file's bytes, the board and the
detector's version, so no entry becomes stale; an unreadable one is ignored. Entries that were not used for the longest
time are removed.
"""

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from omnisight.cache import cache_folder, remove_least_recent, touch
from omnisight.images import write_bytes

# Entries in each of 256 subfolders: 60,000 images, which take about 0.6 GB.
MAX_ENTRIES = 240


def cache_key(data: bytes, *parameters: object) -> str:
    """Return a digest of a file's bytes and of everything else that its result depends on."""
    digest = hashlib.sha256(data)
    digest.update(repr(parameters).encode())
    return digest.hexdigest()


def load_entry(key: str) -> dict[str, Any] | None:
    """Read an entry; None if it is missing or unreadable."""
    path = _path(key)
    try:
        entry = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    touch(path)
    return entry if isinstance(entry, dict) else None


def save_entry(key: str, entry: dict[str, Any]) -> None:
    """Write an entry; a cache that is not writable is not an error."""
    with suppress(OSError):
        path = _path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, json.dumps(entry).encode())
        remove_least_recent(path.parent.glob("*.json"), MAX_ENTRIES)


def _path(key: str) -> Path:
    return cache_folder() / "detections" / key[:2] / f"{key}.json"
