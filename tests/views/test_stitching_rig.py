"""Stitching of a rig of three cameras in a textured sphere of known radius."""

from functools import cache

import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.pipeline.stitch_options import StitchOptions
from omnisight.pipeline.stitch_plan import sphere_bearings
from omnisight.views.stitching.image_stitcher import ImageStitcher
from omnisight.views.stitching.sampling import Sampler
from omnisight.views.stitching.seam_plan import plan_stitch

SIZE, RADIUS_M, OFFSET_M = 400, 1.0, 0.05
FOCAL = SIZE / 2 / np.radians(105)
LENS = om.Camera(
    KannalaBrandt(FOCAL, FOCAL, (SIZE - 1) / 2, (SIZE - 1) / 2, 0.0, 0.0, 0.0, 0.0),
    (SIZE, SIZE),
    theta_max=np.radians(104),
)
ROTATIONS = [exp([0.0, np.radians(degrees), 0.0]) for degrees in (0, 120, -120)]
RIG = om.Rig(
    (LENS,) * 3,
    tuple(om.Pose(rotation, np.array([0.0, 0.0, -OFFSET_M])) for rotation in ROTATIONS),
    ("a", "b", "c"),
)


@cache
def images():
    """Return the images of the rig inside a sphere of 1 m with a random texture."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, (512, 1024)).astype(np.float32), (0, 0), 2)
    texture = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX)
    pixels = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), -1).astype(float)
    bearings, valid = LENS.unproject(pixels)
    found = []
    for pose in RIG.sensor_from_rig:
        centre = pose.inverse().translation
        direction = np.where(valid[..., None], bearings, [0.0, 0.0, 1.0]) @ pose.rotation
        along = -direction @ centre
        reach = along + np.sqrt(along**2 - (centre @ centre - RADIUS_M**2))
        points = centre + reach[..., None] * direction
        u = (np.arctan2(points[..., 0], points[..., 2]) / (2 * np.pi) + 0.5) * 1024
        v = (np.arcsin(points[..., 1] / RADIUS_M) / np.pi + 0.5) * 512
        gray = cv2.remap(
            texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )
        found.append(np.repeat(np.clip(gray, 0, 255).astype(np.uint8)[..., None], 3, -1))
    return found


def test_the_distance_is_that_of_the_scene_even_if_one_camera_shows_no_texture():
    first, _, third = images()
    found = om.stitch([first, np.full_like(first, 128), third], RIG, StitchOptions(width=256, warp=False))
    # Trials near the scene: 0.5, 0.55, 0.61 ... 0.92, 1.1 m.
    assert found.distance == pytest.approx(RADIUS_M, rel=0.15)


def samplers():
    return [Sampler(LENS, pose, np.ones((SIZE, SIZE), bool), RADIUS_M) for pose in RIG.sensor_from_rig]


def test_stitchers_of_one_plan_are_independent():
    plan = plan_stitch(samplers(), images(), 128, warp=False)
    sizes = [(64, 32), (128, 64)]
    stitchers = [ImageStitcher(plan, sphere_bearings(om.sphere(size[0]), np.eye(3))) for size in sizes]
    spheres = [stitcher(images()) for stitcher in (*stitchers, stitchers[0])]
    assert [sphere.shape for sphere in spheres] == [(32, 64, 3), (64, 128, 3), (32, 64, 3)]
    assert np.array_equal(spheres[0], spheres[2])
