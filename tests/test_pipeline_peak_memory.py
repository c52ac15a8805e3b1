"""The largest memory of the process."""

import subprocess
import sys

import numpy as np
import pytest

from omnisight.pipeline.batch.peak_memory import peak_memory_bytes


@pytest.mark.skipif(sys.platform == "win32", reason="not reported")
def test_the_memory_of_the_parent_is_not_that_of_a_process_it_starts():
    block = np.ones(50_000_000)
    own = peak_memory_bytes()
    assert own is not None
    assert own > block.nbytes
    program = "from omnisight.pipeline.batch.peak_memory import peak_memory_bytes; print(peak_memory_bytes())"
    child = int(subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout)
    assert child < block.nbytes / 2
