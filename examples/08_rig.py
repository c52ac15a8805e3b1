"""Render a room with two rigs, two fisheyes and a ring of five cameras, and stitch the images to a sphere."""

import sys
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.simulation import Renderer
from omnisight.simulation.example_rigs import back_to_back, ladybug

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
sphere = om.sphere(1600)
bearings, _ = sphere.unproject(np.stack(np.meshgrid(*map(np.arange, sphere.size)), -1))

for head, rig in {"pair": back_to_back(640), "ring": ladybug(640)}.items():
    om.save(rig, folder / f"{head}.json")
    joined, weight = np.zeros((sphere.height, sphere.width, 3)), np.zeros((sphere.height, sphere.width, 1))
    for name, camera, pose in zip(rig.names, rig.cameras, rig.sensor_from_rig, strict=True):
        image = Renderer(camera, pose.inverse(), vignette=0.1)().image
        om.write_image(folder / f"{head}-{name}.jpg", image)
        # At infinity only the rotation of each camera matters, not its position.
        view = om.Remapper(camera, sphere, pose.rotation.T)
        # In overlaps, weight cameras by the angle from their axis.
        nearer = np.exp(8 * (bearings @ pose.rotation[2]))[..., None] * view.mask[..., None]
        joined += nearer * view(image)
        weight += nearer
    om.write_image(folder / f"{head}.jpg", (joined / np.maximum(weight, 1e-9)).astype(np.uint8))

    # The area of a row decreases with the cosine of its latitude.
    share = np.cos(np.linspace(-np.pi / 2, np.pi / 2, sphere.height))
    seen = ((weight[..., 0] > 0).mean(1) * share).sum() / share.sum()
    print(f"{head}: {', '.join(rig.names)} cover {100 * seen:.1f} % of the sphere; written to {folder}")
