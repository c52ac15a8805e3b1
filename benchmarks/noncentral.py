"""Errors of central and axial calibrations of non-central cameras: the table of docs/guide/noncentral.md.

`python -m benchmarks.noncentral` takes some minutes. The cameras and boards are those of the tests, traced exactly and
independently of the models. The error is that of projecting points at several distances along the true rays.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import omnisight as om

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from noncentral import in_focus, observe_boards, off_focus, projection_errors, pupil_shift_fisheye, sphere

IMAGE_COUNT, NOISE_PX, DISTANCES_M = 20, 0.1, (0.2, 0.4, 1.0, 5.0)
CAMERAS = {
    "lens 10 cm before a ball of 10 cm": sphere,
    "hyperbola, the lens 25 mm off its focus": off_focus,
    "equisolid fisheye, its pupil 8 mm forward at 90 degrees": pupil_shift_fisheye,
    "hyperbola in its focus": in_focus,
}


def main(_: Sequence[str] = ()) -> None:
    """Calibrate each camera, central and axial, and print the errors."""
    print(
        "| camera | | " + " | ".join(f"at {distance:g} m" for distance in DISTANCES_M) + " | held out | non-central |"
    )
    print("|---" * (len(DISTANCES_M) + 4) + "|")
    for name, make in CAMERAS.items():
        truth = make()
        observations, points = observe_boards(truth, IMAGE_COUNT, noise=NOISE_PX)
        for kind, model in (("central", "auto"), ("axial", "axial")):
            calibration = om.calibrate(observations, om.CalibrateOptions(model=model, flat=True))
            corners = calibration.state.points(observations)[0]
            errors = [
                projection_errors(calibration.camera, truth, observations, corners, points, distance)
                for distance in DISTANCES_M
            ]
            figures = " | ".join(f"{np.sqrt((error**2).mean()):.3f}" for error in errors)
            test = calibration.quality.noncentrality
            verdict = "yes" if test is not None and test.is_noncentral else "no"
            print(f"| {name} | {kind} | {figures} | {calibration.held_out_rms:.3f} | {verdict} |", flush=True)


if __name__ == "__main__":
    main()
