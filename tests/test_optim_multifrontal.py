import numpy as np
import pytest
from scipy.linalg import LinAlgError
from scipy.sparse import csr_array
from threadpoolctl import threadpool_info, threadpool_limits

from omnisight.optim.block_matrix import BlockMatrix, BlockPattern
from omnisight.optim.conjugate_gradients import conjugate_gradients
from omnisight.optim.multifrontal import MultifrontalFactor, fronts_of

# Groups, how far apart those of a row are, and share of the rows that connect distant groups.
PROBLEMS = {
    "no columns": (0, 1, 0.0),
    "one group": (1, 1, 0.0),
    "separate groups": (8, 1, 0.0),
    "chain": (60, 4, 0.0),
    "chain with loops": (120, 5, 0.05),
    "almost dense": (40, 40, 0.0),
}


def problem(groups: int, reach: int, loops: float) -> tuple[BlockMatrix, np.ndarray]:
    """Return a positive definite matrix J^T J + I of groups of 1 to 6 columns, as blocks and dense."""
    rng = np.random.default_rng(groups)
    starts = np.concatenate([[0], np.cumsum(rng.integers(1, 7, groups))])
    rows = 4 * groups
    used = (rng.integers(0, groups, (rows, 1)) + rng.integers(0, reach, (rows, 3))) % groups
    far = rng.random(rows) < loops
    used[far] = rng.integers(0, groups, (far.sum(), 3))
    incidence = np.zeros((rows, groups), bool)
    incidence[np.arange(rows)[:, None], used] = True
    jacobian = np.repeat(incidence, np.diff(starts), axis=1) * rng.normal(size=(rows, starts[-1]))
    dense = jacobian.T @ jacobian + np.eye(starts[-1])
    pattern = BlockPattern.of_incidence(starts, csr_array(incidence))
    row, column = np.indices(dense.shape)
    address = pattern.addresses(row, column)
    assert (address[dense != 0] >= 0).all()
    matrix, stored = pattern.zeros(), (address >= 0) & (row >= column)
    matrix.values[address[stored]] = dense[stored]
    return matrix, dense


@pytest.fixture(params=PROBLEMS, scope="module")
def matrices(request):
    return problem(*PROBLEMS[request.param])


@pytest.mark.parametrize("preconditioner", ["none", "diagonal", "exact"])
def test_conjugate_gradients_solve_the_system(matrices, preconditioner):
    matrix, dense = matrices
    inverse = {"none": np.eye(len(dense)), "diagonal": np.diag(1 / np.diag(dense)), "exact": np.linalg.inv(dense)}
    calls, right = list[int](), np.random.default_rng(0).normal(size=len(dense))

    def precondition(residual: np.ndarray) -> np.ndarray:
        calls.append(len(residual))
        return inverse[preconditioner] @ residual

    found, expected = conjugate_gradients(matrix, precondition, right), np.linalg.solve(dense, right)
    error = found - expected
    assert error @ dense @ error <= 1e-8 * (expected @ dense @ expected)
    if preconditioner == "exact":
        assert len(calls) <= 2
    np.testing.assert_array_equal(right, np.random.default_rng(0).normal(size=len(dense)))


def factor_of(matrix: BlockMatrix) -> MultifrontalFactor:
    return MultifrontalFactor.of(matrix, fronts_of(matrix.pattern))


def test_blocks_hold_the_matrix(matrices):
    matrix, dense = matrices
    np.testing.assert_array_equal(matrix.toarray(), dense)
    columns = np.array([[0, -1], [len(dense) - 1, 0]]) if len(dense) else np.full((2, 2), -1)
    expected = np.pad(dense, (0, 1))[columns[:, :, None], columns[:, None, :]]
    np.testing.assert_array_equal(matrix.square(columns), expected)
    scale = np.random.default_rng(0).uniform(1, 2, len(dense))
    np.testing.assert_allclose(matrix.scaled(scale).toarray(), scale[:, None] * dense * scale)
    np.testing.assert_allclose(matrix @ scale, dense @ scale, rtol=1e-12, atol=1e-12)


def test_the_factor_solves_the_system(matrices):
    matrix, dense = matrices
    right = np.random.default_rng(1).normal(size=(len(dense), 3))
    factor = factor_of(matrix)
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(dense, right), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(factor.solve(right[:, 0]), np.linalg.solve(dense, right[:, 0]), rtol=1e-9, atol=1e-10)


def test_the_inverse_has_the_pattern_of_the_matrix(matrices):
    matrix, dense = matrices
    inverse, expected = factor_of(matrix).inverse(), np.linalg.inv(dense)
    is_stored = matrix.pattern.addresses(*np.indices(dense.shape)) >= 0
    np.testing.assert_allclose(inverse.toarray()[is_stored], expected[is_stored], rtol=1e-9, atol=1e-12)


def test_a_chain_has_little_fill_in():
    """A chain of 2000 groups of six columns fills less than 2 % of the 72 million entries of a dense factor."""
    groups, ends = 2000, np.arange(2000)
    incidence = np.zeros((groups, groups), bool)
    for step in range(5):
        incidence[ends, np.minimum(ends + step, groups - 1)] = True
    fronts = fronts_of(BlockPattern.of_incidence(6 * np.arange(groups + 1), csr_array(incidence)))
    assert sum(front.count for front in fronts) == 6 * groups
    assert sum(len(front.columns) * front.count for front in fronts) < 0.02 * (6 * groups) ** 2 / 2


def test_the_threads_of_blas_are_as_before_also_after_a_failure():
    matrix = BlockPattern.dense(4).zeros()
    matrix.add_diagonal(-np.ones(4))
    with threadpool_limits(2, "blas"):
        before = threadpool_info()
        with pytest.raises(LinAlgError, match="not positive definite"):
            factor_of(matrix)
        assert threadpool_info() == before
