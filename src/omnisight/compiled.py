"""How loops are compiled: the outer ones once for all processes, the functions that they call into them.

What is compiled is kept in the user's cache folder under a hash of the sources of its folder: numba itself would look
at the outer loop's file alone, and run stale code after a change of what is compiled into it.
"""

import contextlib
import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config
from numba.core.caching import FunctionCache

from omnisight.cache import cache_folder

# Divisions by zero give inf, as in numpy.
OPTIONS: Any = {"nogil": True, "error_model": "numpy"}

inner = numba.njit(**OPTIONS)


def outer(function: Callable[..., Any]) -> Any:
    """Compile a loop, or take it as it was kept."""
    file = Path(str(sys.modules[function.__module__].__file__))
    return kept(function, cache_folder() / f"loops-{sources(file.parent, '_*.py')}", **OPTIONS)


def kept(function: Callable[..., Any], folder: Path, **options: Any) -> Any:
    """Compile a function with numba's options, or take it as it was kept in a folder."""
    loop: Any = numba.njit(**options)(function)
    config.CACHE_DIR = str(folder)  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(RuntimeError):  # nowhere to keep it
        loop._cache = _Kept(function)
    config.CACHE_DIR = ""  # pyright: ignore[reportAttributeAccessIssue]
    return loop


class _Kept(FunctionCache):
    """What numba keeps: a disk that is full costs the next process time, and must not cost this one its result."""

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


@cache
def sources(folder: Path, pattern: str) -> str:
    """Give a hash of numba's version and of the files of a folder."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(folder.glob(pattern)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
