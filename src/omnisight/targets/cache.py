"""Cache of detections, keyed by the content of the image file.

There is one small JSON file per image in the user's cache folder. The key covers the file's bytes, the board and the
detector's version, so no entry becomes stale; an unreadable one is ignored.
"""

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from omnisight.cache import cache_folder
from omnisight.images import write_bytes


def cache_key(data: bytes, *parameters: object) -> str:
    """Return a digest of a file's bytes and of everything else that its result depends on."""
    digest = hashlib.sha256(data)
    digest.update(repr(parameters).encode())
    return digest.hexdigest()


def load_entry(key: str) -> dict[str, Any] | None:
    """Read an entry; None if it is missing or unreadable."""
    try:
        entry = json.loads(_path(key).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None


def save_entry(key: str, entry: dict[str, Any]) -> None:
    """Write an entry; a cache that is not writable is not an error."""
    with suppress(OSError):
        path = _path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, json.dumps(entry).encode())


def _path(key: str) -> Path:
    return cache_folder() / "detections" / key[:2] / f"{key}.json"
