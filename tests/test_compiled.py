"""The cache of compiled code: shared by processes and threads, independent of numba's own configuration."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from omnisight.cache import MAX_COMPILED_FOLDERS
from omnisight.compilation import compile_in_parallel, watch_compilation
from omnisight.compiled import cached_njit, njit_helper

LOOPS = """
import os, sys, threading
import numpy as np
from numba.core import config
from omnisight.compiled import njit_driver, njit_helper

@njit_helper
def square(x):
    return x * x

@njit_driver
def total(values):
    found = 0.0
    for value in values:
        found += square(value)
    return found

@njit_driver
def largest(values):
    return max(values)


def main():
    folder = config.CACHE_DIR
    types = [np.dtype(name) for name in sys.argv[1:]]
    thread = threading.Thread(target=lambda: [largest(np.arange(4, dtype=t)) for t in types])
    thread.start()
    totals = [total(np.arange(4, dtype=t)) for t in types]
    thread.join()
    assert totals == [14.0] * len(types), totals
    assert [largest(np.arange(4, dtype=t)) for t in types] == [3] * len(types)
    assert config.CACHE_DIR == folder == os.environ.get("NUMBA_CACHE_DIR", "")
    print(*[sum(loop.stats.cache_hits.values()) for loop in (total, largest)])
"""
TYPES = "float64", "int64", "float32", "int32"


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a process which calls compiled loops with arrays of some types."""
    (tmp_path / "_loops.py").write_text(LOOPS)

    def start(*types, cache=tmp_path / "cache"):
        environment = os.environ | {"OMNISIGHT_CACHE": str(cache), "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
        arguments = [sys.executable, "-c", "import _loops; _loops.main()", *types]
        return subprocess.Popen(arguments, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)

    return start


def cache_hits(process):
    output, _ = process.communicate()
    assert process.returncode == 0
    return [int(word) for word in output.split()]


def test_processes_and_threads_share_an_empty_cache(start, tmp_path):
    # Two processes, each with a second thread, need different signatures of the same loops at the same time. One
    # compiles a signature, and the other one loads it.
    hits = [cache_hits(process) for process in [start(*TYPES), start(*reversed(TYPES))]]
    assert np.sum(hits, axis=0).tolist() == [len(TYPES), len(TYPES)]
    assert cache_hits(start(*TYPES)) == [len(TYPES), len(TYPES)]
    assert not (tmp_path / "numba").exists()
    assert not list(tmp_path.glob("__pycache__/*.nb?"))


def test_code_of_old_versions_is_removed_when_that_of_a_new_one_is_stored(start, tmp_path):
    for i in range(MAX_COMPILED_FOLDERS + 3):
        (tmp_path / "cache" / f"loops-{i}").mkdir(parents=True)
        os.utime(tmp_path / "cache" / f"loops-{i}", (i, i))
    assert cache_hits(start("float64")) == [0, 0]
    stored = {path.name for path in (tmp_path / "cache").iterdir()}
    assert len(stored) == MAX_COMPILED_FOLDERS
    assert stored >= {f"loops-{i}" for i in range(4, MAX_COMPILED_FOLDERS + 3)}
    (new,) = stored - {f"loops-{i}" for i in range(MAX_COMPILED_FOLDERS + 3)}
    os.utime(tmp_path / "cache" / new, (0, 0))
    assert cache_hits(start("float64")) == [1, 1]
    assert (tmp_path / "cache" / new).stat().st_mtime > 0


def test_a_cache_that_cannot_be_written_is_no_error(start, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    assert cache_hits(start("float64", cache=tmp_path / "file")) == [0, 0]


def test_the_start_and_the_end_of_a_compilation_are_reported(tmp_path):
    def twice(x):
        return 2 * x

    def call():
        found = []
        with watch_compilation(lambda *report: found.append(report)):
            assert cached_njit(twice, tmp_path)(21) == 42
        return found

    started, (name, seconds) = call()
    assert started == ("twice", None)
    assert name == "twice"
    assert seconds > 0
    assert call() == []  # loaded from the folder


def test_python_cannot_call_a_helper_before_or_after_its_compilation(tmp_path):
    @njit_helper
    def square(x):
        return x * x

    def fourth(x):
        return square(square(x))

    for _ in range(2):
        with pytest.raises(TypeError, match="only compiled functions can call square"):
            square(2.0)
        assert cached_njit(fourth, tmp_path)(2.0) == 16.0


def test_other_cores_compile_parts_as_soon_as_this_process_compiles(tmp_path, monkeypatch):
    (tmp_path / "_parts.py").write_text("""
from pathlib import Path

def first(): Path("first").touch()
def second(): Path("second").touch()
""")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *map(os.path.abspath, sys.path)]))
    monkeypatch.chdir(tmp_path)
    asked = []

    def parts():
        asked.append(True)
        return "_parts:first", "_parts:second"

    def run(threads, folder):
        monkeypatch.setenv("OMNISIGHT_THREADS", str(threads))
        with compile_in_parallel(parts):
            for x in (1, 1.0):  # two compilations, or none
                assert cached_njit(lambda x: x, tmp_path / folder)(x) == x

    run(1, "one")
    assert not asked
    run(2, "two")
    run(3, "two")  # the code is stored
    assert len(asked) == 1
    deadline = time.monotonic() + 60
    while not (tmp_path / "first").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert (tmp_path / "first").exists()
    assert not (tmp_path / "second").exists()


PARTS = """
import numpy as np
import omnisight as om
from compiling import bearings
from omnisight.geometry.pose import Pose
from omnisight.optim._block_jackknife_kernel import deletion_variance
from omnisight.optim._mixture_kernel import fit_mixture
from omnisight.twoview._triangulation_kernel import angular_optimum
from omnisight.visual_odometry.first_run import fit_models
from omnisight.visual_odometry.pose_estimation import estimate_pose
from omnisight.visual_odometry.ray_observations import FrameRays


def count():
    return [len(driver.signatures) for driver in (deletion_variance, fit_mixture, angular_optimum)]

fit_models()
before = count()
a, b = bearings()
assert om.relative_pose(a, b, sigma_deg=0.05)
om.resect(a, b, sigma_deg=0.05)
om.triangulate([Pose(), Pose()], [a, b], sigma_deg=0.05)
estimate_pose(FrameRays(np.arange(len(a)), a, np.zeros_like(a), b, np.zeros((len(a), 2, 3))), Pose())
print(before, count())
assert min(before) > 0
assert count() == before
"""


def test_the_parts_of_the_first_run_are_what_poses_need():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    subprocess.run([sys.executable, "-c", PARTS], check=True, env=environment)
