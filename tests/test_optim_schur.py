import itertools

import numpy as np
import pytest

from omnisight.optim.schur import GroupedNormal


def grouped(counts=(4, 6, 5), shared=3, local=2):
    rng = np.random.default_rng(3)
    rows = sum(counts)
    ends = np.cumsum([0, *counts])
    groups = [slice(a, b) for a, b in itertools.pairwise(ends)]
    a, b, r = rng.normal(size=(rows, 2, shared)), rng.normal(size=(rows, 2, local)), rng.normal(size=(rows, 2))
    dense = np.zeros((2 * rows, shared + local * len(counts)))
    dense[:, :shared] = a.reshape(2 * rows, shared)
    for i, part in enumerate(groups):
        block = b[part].reshape(-1, local)
        dense[2 * part.start : 2 * part.stop, shared + i * local : shared + (i + 1) * local] = block
    return GroupedNormal.assemble(a, b, r, groups), dense, r.ravel()


@pytest.mark.parametrize("damping", [0.0, 1e-3, 10.0])
def test_schur_complement_solves_the_full_system(damping):
    normal, dense, r = grouped()
    hessian = dense.T @ dense
    expected = np.linalg.solve(hessian + damping * np.diag(np.diagonal(hessian)), -dense.T @ r)
    np.testing.assert_allclose(normal.solve(damping), expected, rtol=1e-9, atol=1e-12)


def test_predicted_decrease_is_that_of_the_linearized_cost():
    normal, dense, r = grouped()
    step = np.random.default_rng(0).normal(size=dense.shape[1])
    expected = 0.5 * r @ r - 0.5 * ((r + dense @ step) ** 2).sum()
    assert normal.decrease(step) == pytest.approx(expected, rel=1e-10)


def test_shared_covariance_is_the_block_of_the_inverse():
    normal, dense, _ = grouped()
    expected = np.linalg.inv(dense.T @ dense)[:3, :3]
    np.testing.assert_allclose(normal.shared_covariance(), expected, rtol=1e-9)


def test_a_problem_without_shared_parameters_is_solved():
    normal, dense, r = grouped(shared=0)
    np.testing.assert_allclose(normal.solve(0.0), np.linalg.lstsq(dense, -r, rcond=None)[0], atol=1e-10)
