"""Compiled code is at hand before it is needed."""

import subprocess
import sys

ASKED = """
from lenses import SIZE, lens, observe_boards
from omnisight.calibration import _bundle_kernel, _pose_kernel
from omnisight.pipeline.central import calibrate_camera
from omnisight.targets.observations import Observations
from omnisight.calibration.warm_up import prepare
import numpy as np

loops = [loop for kernel in (_bundle_kernel, _pose_kernel) for loop in vars(kernel).values() if hasattr(loop, "_cache")]
outer = [loop for loop in loops if type(loop._cache).__name__ == "_Kept"]
prepare()
before = [list(loop.signatures) for loop in outer]
calibrate_camera(Observations.of(observe_boards(lens(180), 180, np.random.default_rng(0))), SIZE)
assert len(outer) == 5 and all(before), before
assert [list(loop.signatures) for loop in outer] == before
"""


def test_after_preparing_a_calibration_has_nothing_to_compile(request):
    tests = request.config.rootpath / "tests"
    subprocess.run([sys.executable, "-c", ASKED], cwd=tests, check=True)
