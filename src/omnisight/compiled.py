"""Compilation of loops by numba, cached on disk for all processes.

Compiled code is stored in the user's cache folder under a hash of all sources that it depends on. numba's own cache
checks only the file of the compiled function, so it would run stale code after a change of an inlined function.
numba's configuration (`NUMBA_CACHE_DIR`) is neither read nor changed.
"""

import contextlib
import hashlib
import importlib
import os
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numba.np.linalg
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.caching import _CacheLocator as CacheLocator  # pyright: ignore[reportPrivateUsage]
from numba.core.runtime.nrt import rtsys

from omnisight.cache import cache_folder, record_use, remove_old_code
from omnisight.compilation import report_compilation

# Time in which every function compiles; after it, a process no longer waits for another one.
MAX_COMPILATION_S = 120.0


def _import_without_scipy() -> None:
    """Import the part of numba that imports scipy.linalg only to check that it exists, which takes 0.15 s.

    A compiled function that uses BLAS imports it then. The check is internal to numba: another version may not have it.
    """
    ensure_blas = getattr(numba.np.linalg, "ensure_blas", None)
    if ensure_blas is None:
        return
    numba.np.linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        numba.np.linalg.ensure_blas = ensure_blas


_import_without_scipy()

# numba's own annotations of this class are wrong.
LocatorBase: Any = CacheLocator

# Divisions by zero return inf, as in numpy. No compiled function is called from C.
NJIT_OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def njit_helper(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function that only compiled functions call, with options of numba.

    It has no wrapper for calls from Python, which would be a tenth of its compilation.
    """
    options |= NJIT_OPTIONS | {"no_cpython_wrapper": True}
    dispatcher: Any = numba.njit(**options)(function)

    def add_overload(result: Any) -> None:
        dispatcher.overloads[tuple(result.signature.args)] = result

    def refuse(*arguments: Any) -> None:
        raise TypeError(f"only compiled functions can call {function.__name__}; use njit_driver")

    # numba's own method enters the missing wrapper in the table of the functions that Python can call.
    dispatcher.add_overload, dispatcher._compile_for_args = add_overload, refuse
    return dispatcher


def njit_inlined(function: Callable[..., Any]) -> Any:
    """Compile a small helper for hot loops; its arguments (an array has seven words) would cost more than its work."""
    return njit_helper(function, forceinline=True)


# For loops that make no arrays: without reference counts, which are atomic operations for each array argument of each
# call that is not inlined, and with fused multiplication and addition.
STREAMLINED: Any = {"_nrt": False, "fastmath": {"contract"}}


def njit_driver(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a loop that Python calls, with options of numba; the code is cached on disk.

    Functions that it calls are `njit_helper`s of the `_*.py` files of its folder and of all `_*_kernel.py` files. They
    copy arrays element by element: an array assigned to a slice, and a reduction along an axis, make numba compile the
    text of the error message of wrong shapes, 3 s for each number of dimensions.
    """
    file = Path(str(sys.modules[function.__module__].__file__))
    sources = source_hash(file.parent, "_*.py") + source_hash(Path(__file__).parent, "**/_*_kernel.py")
    return cached_njit(function, cache_folder() / f"loops-{sources}", **NJIT_OPTIONS, **options)


def cached_njit(function: Callable[..., Any], folder: Path, **options: Any) -> Any:
    """Compile a function with options of numba, or load it from a folder where an earlier process stored it."""
    dispatcher: Any = numba.njit(**options)(function)
    dispatcher._cache = FolderCache(function, folder)
    return dispatcher


@cache
def source_hash(folder: Path, pattern: str) -> str:
    """Return a hash of numba's version and of the files of a folder."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(folder.glob(pattern)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def has_code(dispatcher: Any) -> bool:
    """Return whether code of a function from `njit_driver` is stored."""
    return Path(dispatcher._cache._cache_file._index_path).exists()


_record_use = cache(record_use)  # once in a process


class FolderCache(FunctionCache):
    """A cache of compiled functions in a folder; a folder that cannot be read or written is not an error.

    Each signature of a function is compiled by one process, and loaded by those that waited for it.
    """

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        class Locator(LocatorBase):
            _py_file = function.__code__.co_filename  # for numba's warnings

            def get_cache_path(self) -> str:
                return str(folder)

            def get_source_stamp(self) -> str:
                return ""  # the name of the folder holds the hash of the sources

            def get_disambiguator(self) -> str:
                return str(function.__code__.co_firstlineno)

            @classmethod
            def from_function(cls, py_func: object, py_file: str) -> Any:
                return cls()

        class Implementation(CompileResultCacheImpl):
            _locator_classes = (Locator,)

        self._impl_class = Implementation
        super().__init__(function)
        # Files of its own for each process: two that store different signatures at once never mix up index and code.
        files: Any = self._cache_file
        files._data_name_pattern = f"{self._impl.filename_base}.{os.getpid()}-{{number:d}}.nbc"
        self._name, self._started = function.__name__, 0.0
        self._folder, self._lock = folder, None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the stored code of a signature; None if this process is to compile it."""
        if (stored := self._load(sig, target_context)) is not None:
            return stored
        self._started = time.perf_counter()
        report_compilation(self._name, None)
        self._lock = self._file_lock(hashlib.sha256(str(sig).encode()).hexdigest()[:16])
        with contextlib.suppress(OSError, NotImplementedError):
            if not self._folder.exists():
                self._folder.mkdir(parents=True, exist_ok=True)
                remove_old_code()
            self._lock.acquire()
            stored = self._load(sig, target_context)
        if stored is not None:
            self._finish()
        return stored

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code of a signature."""
        # The signatures of a function have one index.
        with contextlib.suppress(OSError, NotImplementedError), self._file_lock("index"):
            super().save_overload(sig, data)
        self._finish()

    def _file_lock(self, part: str) -> Any:
        """Return a lock of a part of the stored code."""
        from filelock import FileLock

        return FileLock(self._folder / f"{self._impl.filename_base}.{part}.lock", timeout=MAX_COMPILATION_S)

    def _load(self, sig: Any, target_context: Any) -> Any:
        # numba's own method also declares every function that code can call: only compilation needs these 0.13 s.
        rtsys.initialize(target_context)
        with contextlib.suppress(OSError), self._guard_against_spurious_io_errors():
            stored = self._load_overload(sig, target_context)
            if stored is not None:
                _record_use(self._folder)
            return stored
        return None

    def _finish(self) -> None:
        """Let other processes load the code."""
        if self._lock is not None:
            self._lock.release()
        report_compilation(self._name, time.perf_counter() - self._started)
