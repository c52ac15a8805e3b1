"""Puts two fisheyes back to back, photographs a room with both, and joins the pictures to a full sphere."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.rig import back_to_back
from omnisight.simulate import Renderer

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
rig = back_to_back(640)
om.save_rig(rig, folder / "rig.json")

sphere = om.sphere(1600)
joined, weight = np.zeros((sphere.height, sphere.width, 3)), np.zeros((sphere.height, sphere.width, 1))
for name, camera, pose in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
    picture = Renderer(camera, pose.inverse(), theta=(0.0, camera.theta_max), vignette=0.1)().image
    om.write_image(folder / f"{name}.jpg", picture)
    # Far away the distance between the cameras does not matter: only how each is turned.
    view = om.Remapper(camera, sphere, pose.rotation.T)
    # Where both see, the one counts more whose axis is nearer.
    bearings, _ = sphere.unproject(np.stack(np.meshgrid(*map(np.arange, sphere.size)), -1))
    nearer = np.exp(8 * (bearings @ pose.rotation[2]))[..., None] * view.mask[..., None]
    joined += nearer * view(picture)
    weight += nearer
om.write_image(folder / "sphere.jpg", (joined / np.maximum(weight, 1e-9)).astype(np.uint8))

seen = (weight[..., 0] > 0).mean()
print(f"{' and '.join(rig.names)}: {100 * seen:.1f} % of the sphere; written to {folder}")
