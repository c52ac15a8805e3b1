"""Motion blur: the mean of sharp images during the exposure, at no more cost than needed."""

import numpy as np
import pytest
from render_cameras import GRAY

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import Renderer, Scene, box
from omnisight.simulation.motion_blur import MAX_POSES, blur_length, exposure_times, shutter_times
from omnisight.simulation.texture import Texture
from omnisight.simulation.trajectory import Trajectory

CAMERA = om.perspective((64, 48), 90)


def wall():
    """Return a white wall with a dark bar, 4 m away."""
    solids = (
        box((-20, -20, 4), (20, 20, 5), GRAY, "wall"),
        box((-0.5, -20, 3.9), (0.5, 20, 4), Texture.plain((20, 20, 20)), "bar"),
    )
    return Scene(solids, spacing=1.0)


def moved(x):
    return om.Pose(translation=np.array((x, 0.0, 0.0)))


def test_blurred_image_is_the_mean_of_sharp_images():
    scene, shifts = wall(), 0.6 * (np.arange(12) + 0.5) / 12 - 0.3
    sharp = [Renderer(CAMERA, moved(x), scene, vignette=0).light() for x in shifts]
    blurred = Renderer(CAMERA, om.Pose(), scene, vignette=0, shutter_poses=[moved(x) for x in shifts]).light()
    np.testing.assert_allclose(blurred, np.mean(sharp, axis=0), atol=0.015)
    still = Renderer(CAMERA, om.Pose(), scene, vignette=0).light()
    assert np.abs(blurred - still).max() > 0.04


def test_ground_truth_is_that_of_the_middle_of_the_exposure():
    scene = wall()
    blurred = Renderer(CAMERA, om.Pose(), scene, shutter_poses=[moved(x) for x in (-0.3, 0.3)])
    np.testing.assert_array_equal(blurred.truth().depth, Renderer(CAMERA, om.Pose(), scene).truth().depth)


def test_a_camera_at_rest_has_the_sharp_image():
    scene = wall()
    sharp, blurred = (Renderer(CAMERA, om.Pose(), scene, shutter_poses=poses) for poses in ((), [om.Pose()] * 4))
    np.testing.assert_allclose(blurred.light(), sharp.light(), atol=1e-6)


def test_blur_length_is_the_motion_of_the_image():
    # f = 32 px: 0.5 m at 4 m are 4 px.
    assert blur_length(CAMERA, om.Pose(), moved(0.5), wall()) == pytest.approx(4, abs=0.2)
    turn = om.Pose(exp((0, np.radians(3), 0)))
    sphere = om.sphere(360)
    assert blur_length(sphere, om.Pose(), turn, Scene(())) == pytest.approx(3, rel=0.1)
    assert blur_length(CAMERA, om.Pose(), om.Pose(), wall()) == pytest.approx(0, abs=1e-9)


def test_the_times_of_an_exposure_are_those_of_its_blur():
    motion = Trajectory(np.array((0.0, 1.0)), (moved(0), moved(5.0)))
    arguments = CAMERA, motion, om.Pose(), wall()
    assert exposure_times(*arguments, (0.5, 0.15), 2) == shutter_times(6.0, 2, 0.5, 0.15)
    assert exposure_times(*arguments, (0.5, 0.0), 2) == []


def test_number_of_poses_grows_with_the_blur():
    counts = [len(shutter_times(length, 2, 0.0, 0.01)) for length in (0.0, 0.05, 0.5, 4.0, 4.5, 12.0, 1e4)]
    assert counts == [0, 0, 4, 4, 8, 12, MAX_POSES]
    times = shutter_times(4.0, 2, 5.0, 0.02)
    np.testing.assert_allclose(times, 5 + 0.02 * np.array((-3, -1, 1, 3)) / 8)
    assert len(shutter_times(2.0, 3, 0.0, 0.01)) == 9
