"""Stitching of a rig of three cameras in a textured sphere of known radius."""

import dataclasses
from functools import cache

import av
import cv2
import numpy as np
import pytest

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.images.planes import Yuv
from omnisight.models.kannala_brandt import KannalaBrandt
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.pipeline.stitching.stitch_plan import sphere_bearings
from omnisight.views.stitching.frame_stitcher import FrameStitcher
from omnisight.views.stitching.image_stitcher import ImageStitcher
from omnisight.views.stitching.photometry import Photometry
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


def test_cameras_are_added_in_an_order_in_which_each_overlaps_those_before_it():
    u, v = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    narrow = np.hypot(u - (SIZE - 1) / 2, v - (SIZE - 1) / 2) < FOCAL * np.radians(50)
    a, b, c = samplers()
    a, b = (dataclasses.replace(sampler, allowed=narrow) for sampler in (a, b))  # 20 degrees apart
    first, second, third = images()
    bearings = sphere_bearings(om.sphere(256), np.eye(3))
    plans = [
        (plan_stitch([a, b, c], [first, second, third], 256, warp=False), [first, second, third]),
        (plan_stitch([a, c, b], [first, third, second], 256, warp=False), [first, third, second]),
    ]
    spheres = [ImageStitcher(plan, bearings)(shown) for plan, shown in plans]
    np.testing.assert_array_equal(*spheres)
    with pytest.raises(ValueError, match=r"camera 2 has no overlap with 1: their fields of view are \d+.\d° apart"):
        plan_stitch([a, b], [first, second], 256)


def stripes(period):
    """Return columns of black and white of a period, px, as the image of each camera."""
    image = np.zeros((SIZE, SIZE, 3), np.uint8)
    image[:, np.arange(SIZE) % period < period // 2] = 255
    return [image] * 3


def as_clip_frames(shown):
    return [Yuv.of(av.VideoFrame.from_ndarray(image, format="rgb24"), 8) for image in shown]


@pytest.mark.parametrize("width", [256, 192])
def test_a_smaller_sphere_averages_the_pixels_of_the_images(width):
    bearings = sphere_bearings(om.sphere(width), np.eye(3))
    plan = plan_stitch(samplers(), images(), 128, warp=False)
    plan = dataclasses.replace(plan, photometry=Photometry(np.zeros((3, 3)), np.zeros(3)))
    fine = stripes(2)
    sphere = ImageStitcher(plan, bearings)(fine).astype(float)
    reference = om.remap(fine[0], LENS, om.sphere(width)).astype(float)
    middle = np.s_[width // 8 : -width // 8, 3 * width // 8 : 5 * width // 8]
    assert sphere.std() < 12
    assert np.abs(sphere[middle] - reference[middle]).max() < 8
    luma = FrameStitcher(plan, bearings)(as_clip_frames(fine)).frame.to_ndarray(format="rgb24").astype(float)
    assert luma.std() < 12
    assert np.abs(luma[middle] - reference[middle]).max() < 8


def test_a_stitched_clip_equals_the_stitched_images_at_all_scales():
    plan = plan_stitch(samplers(), images(), 128, warp=False)
    for width in (256, 512, 1024):
        bearings = sphere_bearings(om.sphere(width), np.eye(3))
        sphere = ImageStitcher(plan, bearings)(images()).astype(float)
        frame = FrameStitcher(plan, bearings)(as_clip_frames(images())).frame.to_ndarray(format="rgb24")
        assert np.sqrt(np.mean((frame - sphere) ** 2)) < 3
