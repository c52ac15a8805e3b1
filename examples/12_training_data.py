"""Train a network on fisheye images, the bearings of their pixels and the masks of valid ones. Needs extra `torch`."""

import sys
import tempfile
from pathlib import Path

import torch

import omnisight as om
from omnisight.simulation import Renderer, scene_named
from omnisight.torch import Camera


class FisheyeImages(torch.utils.data.Dataset):
    def __init__(self, paths, camera):
        bearings, self.valid = (x.detach() for x in Camera(camera).unproject(Camera(camera).grid()))
        self.paths, self.bearings = paths, torch.nan_to_num(bearings).permute(2, 0, 1)

    def __len__(self):
        return len(self.paths)

    def __getitem__(self, index):
        return torch.tensor(om.read_image(self.paths[index])).permute(2, 0, 1) / 255.0, self.bearings, self.valid


folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
camera = om.fisheye(96, fov=180, projection="orthographic")
for k in range(4):
    om.write_image(folder / f"{k}.jpg", Renderer(camera, om.Pose(om.look(yaw=90 * k)), scene_named("room"))().image)
images = FisheyeImages(sorted(folder.glob("*.jpg")), camera)
network = torch.nn.Conv2d(6, 1, 3, padding=1)  # predicts the brightness from the image and the bearings
optimizer = torch.optim.Adam(network.parameters(), lr=0.03)
for _ in range(30):
    for image, bearings, valid in torch.utils.data.DataLoader(images, batch_size=2):
        error = (network(torch.cat([image, bearings], 1))[:, 0] - image.mean(1))[valid]
        optimizer.zero_grad()
        (loss := error.square().mean()).backward()
        optimizer.step()
print(f"{valid.double().mean():.0%} of the pixels have a bearing; learned: {loss.item() < 0.01}")
