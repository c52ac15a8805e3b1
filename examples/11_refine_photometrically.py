"""Refine a fisheye camera and poses by gradient descent on intensities. Needs the extra `torch`."""

import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

import omnisight as om
from omnisight.simulation import Renderer, scene_named
from omnisight.torch import Camera, Pose, sample

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
true = om.Camera(om.model_class("kannala_brandt")(45.0, 45.0, 79.5, 79.5, 0.02, -0.01, 0.0, 0.0), (160, 160))
poses = [om.Pose(om.look(yaw=15 * k, pitch=5 * k), np.array([0.2, 0.1, -0.1]) * k) for k in range(4)]  # cam_from_world
renderers = [Renderer(true, pose.inverse(), scene_named("room")) for pose in poses]
images = [torch.tensor(renderer().image).permute(2, 0, 1) / 255.0 for renderer in renderers]
om.write_image(folder / "first.jpg", renderers[0]().image)

# The colors and the world points of the first image are known; the camera and the other poses are inaccurate.
world, colors = torch.tensor(renderers[0].truth().points[::2, ::2]).float(), images[0][:, ::2, ::2]
seen, world = torch.isfinite(world).all(-1), torch.nan_to_num(world)  # a NaN times a derivative of 0 would be NaN
camera = Camera(om.Camera(true.model.with_values({"fx": 45.7, "fy": 44.3, "cx": 80.0, "k1": 0.0}), true.size))
views = [Pose(poses[0]).requires_grad_(False)] + [Pose(pose.moved(np.full(6, 0.01))) for pose in poses[1:]]
rest = [camera.k1, camera.k2, *(p for view in views[1:] for p in view.parameters())]
px = {"params": [camera.fx, camera.fy, camera.cx, camera.cy], "lr": 0.05}
optimizer = torch.optim.Adam([px, {"params": rest, "lr": 0.002}])
for step in range(100):
    if step in (0, 99):
        error = camera.numpy().project(true.unproject(true.border() * 0.7 + 24)[0])[0] - (true.border() * 0.7 + 24)
        print(f"step {step}: error of the projection {np.sqrt((error**2).sum(1).mean()):.2f} px")
    optimizer.zero_grad()
    for image, view in zip(images, views, strict=True):
        pixels, valid = camera.project(view(world))
        use = valid & seen & camera.in_image(pixels)
        torch.nn.functional.huber_loss(sample(image, pixels, use)[:, use], colors[:, use], delta=0.05).backward()
    optimizer.step()
