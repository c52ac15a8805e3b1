"""Make camera models from the dimensions of mirrors, without images."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.models.unified import Unified

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
size, centre = (1280, 1024), (639.5, 511.5)

# Lengths in millimetres. The lens of a hyperbola is in its second focus, at the distance 2 c from the first.
mirrors = {
    "parabola": Unified.from_parabola(latus_rectum=28.0, scale=34.0, centre=centre),
    "hyperbola": Unified.from_hyperbola(a=28.0, c=38.5, focal=1100.0, centre=centre),
    "ellipse": Unified.from_ellipse(a=40.0, c=25.0, focal=1100.0, centre=centre),
}
for name, model in mirrors.items():
    camera = om.Camera(model, size)
    om.save(camera, folder / f"{name}.json")
    edge = np.degrees(camera.angle_of([centre[0], -0.5]))
    # Image radius and resolution of the horizon.
    pixels, valid = camera.project([[0, -np.sin(a), np.cos(a)] for a in np.radians([89.5, 90.5])])
    horizon = f"{np.linalg.norm(pixels[0] - pixels[1]):.1f} px per degree" if valid.all() else "not seen"
    radius = np.linalg.norm(pixels.mean(0) - centre)
    print(f"{name:9}: xi = {model.xi:.5f}, gamma = {model.fx:.1f} px, top edge {edge:.1f} degrees from the nadir")
    print(f"{'':9}  horizon at radius {radius:.0f} px, {horizon}")
print(f"written to {folder}")
