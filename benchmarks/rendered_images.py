"""Where the benchmarks keep the images that they render."""

import tempfile
from pathlib import Path

from omnisight.cache import cache_folder


def image_cache(benchmark: str) -> Path:
    """Return the folder of the images of a benchmark: in the cache folder, or else in that of temporary files."""
    root = cache_folder() if cache_folder().is_dir() else Path(tempfile.gettempdir())
    return root / f"benchmarks-{benchmark}"
