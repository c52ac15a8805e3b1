"""Cameras and scenes shared by the renderer tests."""

import numpy as np

import omnisight as om
from omnisight.geometry.rays import Rays
from omnisight.geometry.rotation import exp
from omnisight.simulation import Scene, Texture, box, cylinder, ellipsoid, rectangle

GRAY = Texture.plain((119, 119, 119))
POSE = om.Pose(exp((0.1, -0.25, 0.15)), np.array((0.15, -0.1, 0.2)))


class AxialShift:
    """A non-central camera whose entrance pupil moves forward with the angle from the axis."""

    def __init__(self, lens, shift=0.2):
        self.lens, self.size, self.shift = lens, lens.size, shift

    def rays(self, pixels):
        bearings, valid = self.lens.unproject(pixels)
        origins = np.zeros_like(bearings)
        origins[..., 2] = self.shift * (1 - bearings[..., 2])
        return Rays(np.where(valid[..., None], origins, np.nan), bearings, valid)

    def project(self, points):
        x = np.asarray(points, float)
        origin = np.zeros_like(x)
        for _ in range(60):
            towards = x - origin
            towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
            origin[..., 2] = self.shift * (1 - towards[..., 2])
        return self.lens.project(x - origin)


class SideBySidePinholes:
    """Two pinholes in one image: the left half has the left viewpoint."""

    def __init__(self, size=(160, 120), base=0.2):
        self.size, self.half, self.base = size, om.perspective((size[0] // 2, size[1]), 70), base

    def _eye(self, side):
        return np.array((self.base * (side - 0.5), 0, 0))

    def rays(self, pixels):
        p = np.array(pixels, float)
        side = p[..., 0] >= self.size[0] / 2 - 0.5
        p[..., 0] -= np.where(side, self.size[0] // 2, 0)
        bearings, valid = self.half.unproject(p)
        return Rays(np.where(side[..., None], self._eye(1), self._eye(0)), bearings, valid)

    def project(self, points):
        pixels, valid = self.half.project(np.asarray(points, float) - self._eye(0))
        return pixels, valid & self.half.in_image(pixels)


CAMERAS = {
    "pinhole": om.perspective((120, 90), 80),
    "fisheye": om.fisheye(110, 200),
    "sphere": om.sphere(128),
    "axial": AxialShift(om.fisheye(100, 170)),
    "side by side": SideBySidePinholes(),
}


def still_life():
    """Return a scene with an ellipsoid, a box and a cylinder in front of a wall, without a sky."""
    wall = rectangle((-6, -6, 5), (12, 0, 0), (0, 12, 0), GRAY, "wall")
    solids = (
        wall,
        ellipsoid((0.2, 0.1, 3.0), (0.6, 0.5, 0.7), GRAY, "ellipsoid"),
        box((-2.2, -0.8, 2.5), (-1.2, 0.9, 3.4), GRAY, "box"),
        cylinder((1.3, -1.0, 3.1), (1.8, 1.0, 2.7), 0.3, GRAY, "cylinder"),
    )
    return Scene(solids, ambient=1.0, spacing=0.5)


def pixels_of(camera):
    return np.stack(np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1])), -1).astype(float)
