"""How the ray caster is compiled: the outer loops once for all processes, the inner functions into them.

What is compiled is kept in the user's cache folder under a hash of all sources: numba itself would look at the outer
loop's file alone, and run stale code after a change of an inner one.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from omnisight.cache import cache_folder

# Divisions by zero give inf, as in numpy: a ray that never meets a plane meets it at infinity.
OPTIONS: Any = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}


def _sources() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("_*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


FOLDER = cache_folder() / f"rays-{_sources()}"

inner = numba.njit(forceinline=True, **OPTIONS)


def outer(function: Callable[..., Any]) -> Any:
    """Compile a loop, or take it as it was kept."""
    config.CACHE_DIR = str(FOLDER)  # pyright: ignore[reportAttributeAccessIssue]
    try:
        return numba.njit(cache=True, **OPTIONS)(function)
    finally:
        config.CACHE_DIR = ""  # pyright: ignore[reportAttributeAccessIssue]
