"""A camera maps pixels to bearings, unit vectors in its frame, and back; also for what lies beside or behind it."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import fisheye_setup

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
om.save(fisheye_setup().camera, folder / "fisheye.json")

camera = om.load(folder / "fisheye.json")  # omnisight's own JSON, or any other format that it reads
print(f"{camera.model.name}, {camera.width}x{camera.height} px")

pixels = [[480, 360], [700, 360], [835, 360], [2000, 360]]
bearings, valid = camera.unproject(pixels)
for pixel, bearing, angle, known in zip(pixels, bearings, np.degrees(camera.angle_of(pixels)), valid, strict=True):
    seen = f"bearing {bearing.round(4)}, {angle:.2f} degrees from the axis" if known else "outside of the lens"
    print(f"pixel {pixel}: {seen}")

back, _ = camera.project(bearings[valid])
print(f"there and back: {np.abs(back - np.array(pixels)[valid]).max():.1e} px")

# The distance of a point does not matter, and one at z <= 0 is seen as any other, as far as the lens goes.
points = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [1.0, 0.0, -0.05], [0.0, 0.0, -1.0]])
seen, valid = camera.project(points)
for point, pixel, known in zip(points, seen, valid, strict=True):
    print(f"point {point} is seen at {pixel.round(2)}, in the image: {camera.in_image(pixel)}, valid: {known}")

one, other = bearings[0], bearings[1]
print(f"angle between the first two: {np.degrees(np.arccos(one @ other)):.2f} degrees")
