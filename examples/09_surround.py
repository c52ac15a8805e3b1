"""Render the four fisheyes of a car in a street, and compute a bird's-eye view of the ground around it."""

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

import omnisight as om
from omnisight.simulation import Renderer, scene_named
from omnisight.simulation.example_rigs import surround_car

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
rig = surround_car(640)
om.save(rig, folder / "car.json")

street = scene_named("street")
world_from_rig = om.Pose(translation=np.array((-1.5, 1.6, -3.0)))  # on the road, which lies 1.6 m below the origin

# The ground 4 m to either side and 6 m ahead and behind, at 60 pixels per metre, projected into each camera.
x, z = np.meshgrid(np.arange(-4, 4, 1 / 60), np.arange(6, -6, -1 / 60))
ground = np.stack([x, np.zeros_like(x), z], -1)
pixels, seen = rig.project(ground)[0], rig.in_view(ground)

joined, weight = np.zeros((*x.shape, 3)), np.zeros((*x.shape, 1))
for k, (name, camera, pose) in enumerate(zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True)):
    image = Renderer(camera, world_from_rig @ pose.inverse(), street, vignette=0.1)().image
    om.write_image(folder / f"{name}.jpg", image)
    u, v = np.nan_to_num(pixels[k], nan=-1e4).astype(np.float32).transpose(2, 0, 1)
    near = (seen[k] / np.linalg.norm(pose @ ground, axis=-1) ** 4)[..., None]  # weight the nearest camera most
    joined += near * cv2.remap(image, u, v, cv2.INTER_LINEAR)
    weight += near
above = (joined / np.maximum(weight, 1e-9)).astype(np.uint8)
cv2.rectangle(above, (185, 225), (295, 495), (40, 40, 44), -1)  # the car itself: 1.8 by 4.5 m
om.write_image(folder / "above.jpg", above)

print(f"{', '.join(rig.names)}: {100 * (weight > 0).mean():.0f} % of the ground around the car; written to {folder}")
