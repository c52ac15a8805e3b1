"""Cholesky factorization of large matrices on machines that other programs use too."""

import ctypes
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import cho_factor

Array = NDArray[np.float64]

# Columns up to which two threads save less than 10 ms (measured with OpenBLAS 0.3.30 on two cores).
MAX_SERIAL_COLUMNS = 2000


def factor_cholesky(matrix: Array) -> tuple[Array, bool]:
    """Return the factor of a matrix (N, N), of which the lower triangle is used and overwritten, for `cho_solve`.

    The threads of OpenBLAS wait for each other without sleeping: on two cores with two other busy processes, 1200
    columns took 370 ms on average, and 40 ms with one thread.

    Raises
    ------
    LinAlgError
        If the matrix is not positive definite.
    """
    if len(matrix) > MAX_SERIAL_COLUMNS:
        return cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    with one_blas_thread():
        return cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)


@contextmanager
def one_blas_thread() -> Generator[None]:
    """Let scipy's OpenBLAS use one thread; without effect if scipy has another BLAS."""
    blas = _openblas()
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
