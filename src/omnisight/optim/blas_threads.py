"""Number of threads of BLAS on machines that other programs use too."""

import ctypes
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import scipy

# Columns of a matrix up to which two threads save less than 10 ms (measured with OpenBLAS 0.3.30 on two cores).
MAX_SERIAL_COLUMNS = 2000


@contextmanager
def blas_threads_for(columns: int) -> Generator[None]:
    """Let scipy's OpenBLAS use one thread for matrices of few columns; without effect if scipy has another BLAS.

    The threads of OpenBLAS wait for each other without sleeping: on two cores with two other busy processes, the
    Cholesky factorization of 1200 columns took 370 ms on average, and 40 ms with one thread.
    """
    blas = _openblas() if columns <= MAX_SERIAL_COLUMNS else None
    if blas is None:
        yield
        return
    threads = blas.scipy_openblas_get_num_threads()
    blas.scipy_openblas_set_num_threads(1)
    try:
        yield
    finally:
        blas.scipy_openblas_set_num_threads(threads)


@cache
def _openblas() -> Any:
    """Return the OpenBLAS of scipy's wheels; None if scipy has another BLAS."""
    folder = Path(scipy.__file__).parent
    for libraries in (folder.with_name("scipy.libs"), folder / ".dylibs"):
        for path in libraries.glob("*openblas*"):
            library = ctypes.CDLL(str(path))
            if hasattr(library, "scipy_openblas_set_num_threads"):
                return library
    return None
