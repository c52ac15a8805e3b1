"""Number of threads of BLAS for small matrices."""

from contextlib import AbstractContextManager, nullcontext

from omnisight.parallel import serial_blas

# Columns of a matrix up to which two threads save less than 10 ms (measured with OpenBLAS 0.3.30 on two cores).
MAX_SERIAL_COLUMNS = 2000


def blas_threads_for(columns: int) -> AbstractContextManager[None]:
    """Let BLAS use one thread for matrices of few columns."""
    return serial_blas() if columns <= MAX_SERIAL_COLUMNS else nullcontext()
