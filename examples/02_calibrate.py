"""Calibrates a fisheye from images of a checkerboard: no guess of focal length, field of view or centre."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
board = om.Checkerboard.parse("8x5", "40mm")  # inner corners, and the side of a square

setup = fisheye_setup(640)  # stands for your camera: put your own images into the folder instead
renderer = setup.renderer()
for i, held in enumerate(setup.boards(8, board)):
    om.write_image(folder / f"shot{i}.png", renderer([held], np.random.default_rng(i)).image)

search = om.detect_boards(sorted(folder.glob("shot*.png")), board)
result = om.calibrate_pictures(search).calibration
om.save(result.camera, folder / "camera.json")

print(f"{len(search.found)} of {len(search.images)} images, {len(result.views.pixels)} corners")
print(f"rms {result.rms:.3f} px")
print(result.reason)
print(f"corners reach {np.degrees(result.camera.theta_max or 0):.0f} degrees from the axis")
print(f"written: {folder / 'camera.json'}")
