"""Images of a textured sphere through any camera: a pair is related by a rotation, which is the truth."""

import dataclasses
import functools

import cv2
import numpy as np

import omnisight as om
from omnisight.models.unified import Unified

# Width of the texture: a multiple of the widths of the images, so that columns shift by whole pixels.
TEXTURE = om.sphere(2048)
SPHERE = om.sphere(1024)
FISHEYE = dataclasses.replace(om.fisheye(560, 190), theta_max=np.radians(90))
# A negative fx exchanges left and right.
MIRROR = om.Camera(
    Unified(-155.0, 155.0, 299.5, 299.5, xi=0.97), (600, 600), theta_min=np.radians(20), theta_max=np.radians(105)
)
PERSPECTIVE = om.perspective((480, 360), 60)
CAMERAS = {"sphere": SPHERE, "fisheye": FISHEYE, "mirror": MIRROR, "perspective": PERSPECTIVE}


@functools.cache
def texture():
    """Return an equirectangular image of blobs and blocks of several sizes."""
    rng = np.random.default_rng(0)
    total = np.zeros((TEXTURE.height, TEXTURE.width), np.float32)
    for cell in (8, 16, 32, 64, 128):
        coarse = rng.normal(size=(TEXTURE.height // cell, TEXTURE.width // cell)).astype(np.float32)
        blocks = np.kron(coarse, np.ones((cell, cell), np.float32))
        total += cv2.GaussianBlur(np.pad(blocks, ((0, 0), (cell, cell)), "wrap"), (0, 0), 1.5)[:, cell:-cell]
    return np.clip(128 + 28 * total, 0, 255).astype(np.uint8)


def photograph(camera, cam_from_world=None):
    """Return the image of the sphere through a camera, black outside its calibrated field of view."""
    result = om.remap(texture(), TEXTURE, camera, cam_from_world)
    bearings, valid = camera.unproject(np.stack(np.meshgrid(*map(np.arange, camera.size)), -1))
    result[~(valid & camera.calibrated(bearings))] = 0
    return result
