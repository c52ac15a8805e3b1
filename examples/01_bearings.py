"""Convert pixels to bearings, unit vectors in the camera frame, and back, also beside and behind the camera."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
om.save(fisheye_setup().camera, folder / "fisheye.json")

camera = om.load(folder / "fisheye.json")  # reads calibration files of any format
print(f"{camera.model.name}, {camera.width}x{camera.height} px")

pixels = np.array([[480, 360], [700, 360], [835, 360], [2000, 360]])
bearings, valid = camera.unproject(pixels)
for pixel, bearing, angle, ok in zip(pixels, bearings, np.degrees(camera.angle_of(pixels)), valid, strict=True):
    text = f"bearing {bearing.round(4)}, {angle:.2f} degrees off-axis" if ok else "outside the domain of the model"
    print(f"pixel {pixel}: {text}")

reprojected, _ = camera.project(bearings[valid])
print(f"round trip error: {np.abs(reprojected - pixels[valid]).max():.1e} px")

# Only the direction of a point matters. Points with z <= 0 are valid up to the edge of the domain.
points = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [1.0, 0.0, -0.05], [0.0, 0.0, -1.0]])
projected, valid = camera.project(points)
for point, pixel, ok in zip(points, projected, valid, strict=True):
    print(f"point {point}: pixel {pixel.round(2)}, in the image: {camera.in_image(pixel)}, valid: {ok}")

print(f"angle between the first two bearings: {np.degrees(np.arccos(bearings[0] @ bearings[1])):.2f} degrees")
