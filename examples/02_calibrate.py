"""Calibrate a fisheye from images of a checkerboard, without an initial guess."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

setup = fisheye_setup(640)  # replace by your own images in the folder
renderer = setup.renderer()
for i, board in enumerate(setup.boards(8, om.Checkerboard.parse("8x5", "40mm"))):
    om.write_image(folder / f"image{i}.png", renderer([board], np.random.default_rng(i)).image)

calibration = om.calibrate(folder, om.CalibrateOptions(square="40mm"))
om.save(calibration.camera, folder / "camera.json")

observations = calibration.observations
print(f"{len(observations)} of {len(observations.image_names)} images, {len(observations.pixels)} corners")
print(f"rms {calibration.rms:.3f} px, held-out error {calibration.held_out_rms:.3f} px")
print(f"calibrated to {np.degrees(calibration.camera.theta_max):.0f} degrees off-axis")
print(f"verdict: {calibration.verdict}", *calibration.reasons, sep="\n- ")
print(f"written: {folder / 'camera.json'}")
