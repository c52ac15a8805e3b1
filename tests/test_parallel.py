"""Parallel loops: order, loops inside of loops, threads of BLAS."""

import subprocess
import sys

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from omnisight.parallel import parallel_for, parallel_map, serial_blas

# A program in a process of its own: a loop that waits for itself would never end.
NESTED = """
import numpy as np
from omnisight.parallel import parallel_for, parallel_map

def rows(i):
    filled = np.zeros(4)
    def fill(first, last):
        filled[first:last] = parallel_map(lambda j: 10.0 * i + j, range(first, last))
    parallel_for(fill, 4, 1)
    return filled.tolist()

assert parallel_map(rows, range(8)) == [[10.0 * i + j for j in range(4)] for i in range(8)]
"""


def blas_threads():
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_loops_inside_of_loops_end(monkeypatch):
    monkeypatch.setenv("OMNISIGHT_THREADS", "2")
    subprocess.run([sys.executable, "-c", NESTED], check=True, timeout=60)


@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_order_with_any_number_of_threads(threads, monkeypatch):
    monkeypatch.setenv("OMNISIGHT_THREADS", str(threads))
    reports, filled = [], np.zeros(20)
    squares = parallel_map(lambda i: i * i, range(20), lambda *report: reports.append(report))
    assert squares == [i * i for i in range(20)]
    assert reports == [(i, 20) for i in range(1, 21)]

    def fill(first, last):
        filled[first:last] = 1 + np.arange(first, last)

    parallel_for(fill, 20, 4)
    np.testing.assert_array_equal(filled, 1 + np.arange(20))


def test_blas_has_one_thread_in_each_thread_of_a_loop_and_its_own_number_after_it(monkeypatch):
    monkeypatch.setenv("OMNISIGHT_THREADS", "2")
    with threadpool_limits(2, "blas"):
        assert blas_threads() == {2}

        def inside(_):
            with serial_blas():
                pass
            return blas_threads()

        assert parallel_map(inside, range(4)) == [{1}] * 4
        assert blas_threads() == {2}
