"""What calibrations of cameras whose rays do not meet in a point leave: the table of docs/guide/noncentral.md.

`python -m benchmarks.noncentral` takes some minutes. The cameras and boards are those of the tests, traced exactly by
other means than the model's, and true rays are asked, so far along them, by how many px each calibration is off.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from omnisight.pipeline.noncentral import calibrate_rays

import omnisight as om

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from noncentral import SIZE, in_focus, observe_boards, off_focus, projection_errors, pupil_shift_fisheye, sphere

IMAGE_COUNT, NOISE_PX, DISTANCES_M = 20, 0.1, (0.2, 0.4, 1.0, 5.0)
CAMERAS = {
    "lens 10 cm before a ball of 10 cm": sphere,
    "hyperbola, the lens 25 mm off its focus": off_focus,
    "equisolid fisheye, its pupil 8 mm forward at 90 degrees": pupil_shift_fisheye,
    "hyperbola in its focus": in_focus,
}


def main(_: Sequence[str] = ()) -> None:
    """Calibrate each camera, central and axial, and print what is left."""
    print("| camera | | " + " | ".join(f"at {distance:g} m" for distance in DISTANCES_M) + " | held out | needed |")
    print("|---" * (len(DISTANCES_M) + 4) + "|")
    for name, make in CAMERAS.items():
        truth = make()
        views, points = observe_boards(truth, IMAGE_COUNT, noise=NOISE_PX)
        central = om.calibrate_camera(views, SIZE, flat=True)
        rays = calibrate_rays(central, unit="m")
        for kind, found in (("central", central), ("axial", rays)):
            corners = found.state.points(views)[0]
            off = [projection_errors(found.camera, truth, views, corners, points, distance) for distance in DISTANCES_M]
            figures = " | ".join(f"{np.sqrt((o**2).mean()):.3f}" for o in off)
            held = f"{found.held_out_rms:.3f} | {'yes' if rays.needed else 'no'}"
            print(f"| {name} | {kind} | {figures} | {held} |", flush=True)


if __name__ == "__main__":
    main()
