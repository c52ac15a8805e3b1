import numpy as np
import pytest
from scipy.linalg import LinAlgError, cho_solve

from omnisight.optim import cholesky


@pytest.mark.parametrize("size", [3, 300])
def test_the_factor_solves_the_system_of_the_lower_triangle(size):
    rng = np.random.default_rng(0)
    half = rng.normal(size=(size, size + 5))
    matrix, right = half @ half.T, rng.normal(size=size)
    lower = np.tril(matrix) + np.triu(np.full_like(matrix, np.nan), 1)
    found = cho_solve(cholesky.factor_cholesky(lower.copy()), right, check_finite=False)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, right), rtol=1e-6)


def test_the_threads_of_blas_are_as_before_also_after_a_failure():
    blas = cholesky._openblas()
    if blas is None:
        pytest.skip("scipy has another BLAS than OpenBLAS")
    before = blas.scipy_openblas_get_num_threads()
    blas.scipy_openblas_set_num_threads(2)
    try:
        with pytest.raises(LinAlgError):
            cholesky.factor_cholesky(-np.eye(4))
        assert blas.scipy_openblas_get_num_threads() == 2
    finally:
        blas.scipy_openblas_set_num_threads(before)
