"""Look at cameras as in a notebook: field of view, texts, comparison, pose of an object, and a map for OpenCV."""

import sys
from pathlib import Path

import numpy as np

import omnisight as om

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
camera = om.fisheye((640, 480), fov=170, projection="equisolid")
print(camera, f"\nfield of view {camera.fov.horizontal:.1f}° x {camera.fov.vertical:.1f}°, {camera.focal:.1f} px/rad")

# Two calibrations of one camera: the same model with small errors, and the covariance that explains them.
sigma = np.array([0.1, 0.1, 0.2, 0.2])
estimates = [
    om.Camera(camera.model.with_params(camera.model.params + sign * sigma), camera.size, covariance=np.diag(sigma**2))
    for sign in (0.5, -0.5)
]
print(om.compare(*estimates).sentence)

# Pose of a known object from pixels, some of which are wrong.
rng = np.random.default_rng(0)
points = rng.uniform(-1, 1, (30, 3))
truth = om.Pose(om.look(yaw=30), np.array([0.2, 0.1, 2.5]))
pixels = camera.project(truth @ points)[0] + rng.normal(0, 0.2, (30, 2))
pixels[:6] += 40
print(om.resect(points, pixels, 0.04 * np.eye(2), camera=camera))

# The map of a view, for cv2.remap in a program without omnisight.
view = om.ViewOptions(fov=90, yaw=30, size=(320, 240))
print(om.export_map(camera, folder / "map.npy", "opencv-map", view).usage)

# A Camera is shown with its radial profile in a notebook; `om.plot_profile(camera)` is a figure of matplotlib.
(folder / "camera.html").write_text(camera._repr_html_() or "", encoding="utf-8")
