"""Reuse the map of a view for many frames."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import fisheye_setup

FRAMES = 60
folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
setup = fisheye_setup()
renderer = setup.renderer()
board = setup.boards(1)
frames = [renderer(boards, np.random.default_rng(i)).image for i, boards in enumerate(([], board))]

start = time.perf_counter()
remapper = om.Remapper(setup.camera, om.perspective((1280, 720), 100))
print(f"map: {1000 * (time.perf_counter() - start):.0f} ms")
print(f"a view pixel spans {remapper.scale[0]:.2f} to {remapper.scale[1]:.2f} frame pixels")
print(f"the frame covers {remapper.mask.mean():.0%} of the view")

view = remapper(frames[0])
start = time.perf_counter()
for i in range(FRAMES):
    view = remapper(frames[i // 10 % 2])
seconds = time.perf_counter() - start
print(f"{FRAMES} frames to 1280x720: {FRAMES / seconds:.0f} fps")
om.write_image(folder / "last.jpg", view)
print(f"written to {folder / 'last.jpg'}")
