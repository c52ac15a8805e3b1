"""Calibration loops are compiled before they are needed."""

import subprocess
import sys

SCRIPT = """
from calibrating import SIZE
from lenses import lens, observe_boards
from omnisight.calibration import _bundle_kernel, _resection_kernel
from omnisight.calibration.warm_up import start_warm_up
from omnisight.compiled import FolderCache
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import resect
from omnisight.targets.observations import Observations
import numpy as np

loops = [loop for kernel in (_bundle_kernel, _resection_kernel) for loop in vars(kernel).values()]
loops = [loop for loop in loops if isinstance(getattr(loop, "_cache", None), FolderCache)]
thread = start_warm_up()
assert thread.daemon
thread.join()
before = [list(loop.signatures) for loop in loops]
points, pixels = zip(*observe_boards(lens(180), 180, np.random.default_rng(0)))
observations = Observations.from_arrays(points, pixels, size=SIZE)
refine(resect(lens(180), observations), observations)
assert len(loops) == 5 and all(before), before
assert [list(loop.signatures) for loop in loops] == before
"""


def test_a_calibration_after_the_warm_up_compiles_nothing(request):
    tests = request.config.rootpath / "tests"
    subprocess.run([sys.executable, "-c", SCRIPT], cwd=tests, check=True)
