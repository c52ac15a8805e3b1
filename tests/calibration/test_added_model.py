"""A camera model added as a file takes part in the automatic selection."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

SCRIPT = """
import sys

import numpy as np

import omnisight.models as models

models.__path__.append(sys.argv[1])

from calibrating import calibrate, observe
from lenses import bearing_error, observe_boards
from omnisight.models import auto_models, model_class

assert "sine" in auto_models(1.3)
truth = model_class("sine").from_dict({"fx": 300.0, "fy": 300.0, "cx": 481.0, "cy": 476.0, "w": 0.9})
views = observe_boards(truth, 150, np.random.default_rng(0), count=10, noise=0.05)
calibration = calibrate(observe(views), flat=True)
names = {candidate.name.split()[0] for candidate in calibration.candidates}
assert {"sine", "unified", "ocam"} <= names, names
figures = [candidate.as_dict() for candidate in calibration.candidates]
assert calibration.camera.model.name == "sine", (calibration.selection.reason, figures)
assert abs(calibration.camera.model.w - 0.9) < 0.01
assert bearing_error(calibration.camera, truth, 0.95 * calibration.camera.theta_max) < 0.1
"""


def test_model_added_as_a_file_is_selected_for_its_own_lens(tmp_path):
    (model,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    (tmp_path / "sine.py").write_text(model, encoding="utf-8")
    # A new process, because the models are listed once per process.
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)], cwd=ROOT / "tests", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
