"""How loops are compiled: the outer ones once for all processes, the functions that they call into them.

What is compiled is kept in the user's cache folder under a hash of the sources of its folder: numba itself would look
at the outer loop's file alone, and run stale code after a change of what is compiled into it.
"""

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from omnisight.cache import cache_folder

# Divisions by zero give inf, as in numpy.
OPTIONS: Any = {"nogil": True, "error_model": "numpy"}

inner = numba.njit(**OPTIONS)


def outer(function: Callable[..., Any]) -> Any:
    """Compile a loop, or take it as it was kept."""
    file = Path(str(sys.modules[function.__module__].__file__))
    config.CACHE_DIR = str(cache_folder() / f"loops-{_sources(file.parent)}")  # pyright: ignore[reportAttributeAccessIssue]
    try:
        return numba.njit(cache=True, **OPTIONS)(function)
    finally:
        config.CACHE_DIR = ""  # pyright: ignore[reportAttributeAccessIssue]


@cache
def _sources(folder: Path) -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(folder.glob("_*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
