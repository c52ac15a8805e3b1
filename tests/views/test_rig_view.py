"""Views of a rig: its images as those of one camera at its origin."""

import dataclasses

import numpy as np
import pytest

import omnisight as om

WORLD = om.sphere(512)
LENS = dataclasses.replace(om.fisheye(320, 200.0), theta_max=np.radians(100.0))
POSES = {"front": om.look(), "back": om.look(yaw=180)}
DISTANCE = 2.0


def colours(bearings):
    """Return the smooth colours (..., 3) of directions (..., 3)."""
    return 127.5 + 100 * np.sin(2 * bearings + [0.0, 1.0, 2.0])


def bearings_of(camera):
    """Return the bearings (H, W, 3) of all pixels."""
    return camera.unproject(np.stack(np.meshgrid(*map(np.arange, camera.size)), -1).astype(float))[0]


def head(shift):
    """Return a rig of two lenses with a baseline, and its images of a sphere around its origin."""
    poses = {name: om.Pose(turn, np.array([0.0, 0.0, shift])) for name, turn in POSES.items()}
    rig = om.Rig.from_sensors({name: (LENS, pose) for name, pose in poses.items()})
    images = []
    for pose in rig.sensor_from_rig:
        # The ray o + s d meets the sphere of the scene.
        rig_from_sensor, direction = pose.inverse(), bearings_of(LENS) @ pose.rotation
        origin = rig_from_sensor.translation
        along = direction @ origin
        points = origin + (np.sqrt(along**2 + DISTANCE**2 - origin @ origin) - along)[..., None] * direction
        image = colours(points / DISTANCE)
        images.append(np.where(np.isfinite(image), image, 0.0))
    return rig, images


@pytest.mark.parametrize("target", [WORLD, om.perspective((200, 150), 90)])
def test_a_view_of_a_rig_is_that_of_a_camera_at_its_origin(target):
    rig, images = head(0.05)
    turn = om.look(yaw=80, pitch=20)
    view = om.remap(images, rig, target, turn, distance=DISTANCE)
    assert view.dtype == images[0].dtype
    assert np.abs(view - colours(bearings_of(target) @ turn)).max() < 1.0
    far = om.remap(images, rig, target, turn)
    assert np.abs(far - colours(bearings_of(target) @ turn)).max() > 2.0


def test_gray_images_give_a_gray_view():
    rig, images = head(0.0)
    gray = [image[..., 0].astype(np.uint8) for image in images]
    view = om.remap(gray, rig, WORLD)
    assert (view.shape, view.dtype) == ((256, 512), np.uint8)
    assert np.abs(view - colours(bearings_of(WORLD))[..., 0]).max() < 2.0


def test_wrong_images_and_options_are_refused():
    rig, images = head(0.0)
    with pytest.raises(ValueError, match="1 images, and the rig has 2 cameras: front, back"):
        om.remap(images[:1], rig, WORLD)
    with pytest.raises(ValueError, match="back: the image is 320x300, the camera 320x320"):
        om.remap([images[0], images[1][:300]], rig, WORLD)
    with pytest.raises(ValueError, match="distance of the scene must be positive"):
        om.remap(images, rig, WORLD, distance=0.0)
    with pytest.raises(ValueError, match="bilinear"):
        om.remap(images, rig, WORLD, interpolation="bicubic")
    with pytest.raises(ValueError, match="distance is for rigs"):
        om.remap(images[0], LENS, WORLD, distance=2.0)
