"""Light of the renderer: texture filtering, exposure, noise, image circle, vignette and JPEG."""

import numpy as np
import pytest
from render_cameras import GRAY, POSE, pixels_of, still_life

import omnisight as om
from omnisight.simulation import Renderer, Scene, Texture, box, ellipsoid, render
from omnisight.simulation.texture import LINEAR

# -- energy ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_constant_scene_renders_exactly_constant(any_camera, samples):
    colour = Texture(np.full((37, 50, 3), (90, 120, 150), np.uint8))
    shell = box((-3, -3, -3), (3, 3, 3), colour, "shell", inside=True, glow=1.0)
    inner = ellipsoid((0.5, 0.2, 2.0), 0.4, colour, "ellipsoid", glow=1.0)
    scene = Scene((shell, inner), sky=colour)
    light = Renderer(any_camera, POSE, scene, samples=samples, vignette=0).light()
    inside = any_camera.rays(pixels_of(any_camera)).valid
    inside[[0, -1]] = inside[:, [0, -1]] = False  # at the rim a ray of a pixel may see nothing
    for k in range(1, 3):
        inside[k:] &= inside[:-k]
        inside[:-k] &= inside[k:]
        inside[:, k:] &= inside[:, :-k]
        inside[:, :-k] &= inside[:, k:]
    assert inside.sum() > 1000
    assert (light[inside] == LINEAR[[90, 120, 150]]).all()


def test_background_without_a_sky_is_black(any_camera):
    assert not Renderer(any_camera, POSE, Scene(())).light().any()


def test_texture_filtering_preserves_the_mean_light(any_camera):
    """The mean of a fine checkered wall is that of its colours, at any distance: no aliasing, no loss of light."""
    squares = np.indices((512, 512)).sum(0) % 2
    texture = Texture(np.repeat((squares * 255).astype(np.uint8)[..., None], 3, -1))
    shell = box((-3, -3, -3), (3, 3, 3), texture, "shell", inside=True, glow=1.0)
    light = Renderer(om.perspective(60, (80, 60)), POSE, Scene((shell,)), vignette=0).light()
    assert abs(light.mean() - 0.5) < 0.01
    assert light.std() < 0.06


def test_exposure_doubles_the_light_per_stop():
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    images = [
        render(om.perspective(60, (20, 16)), scene=Scene((shell,)), vignette=0, noise=0, exposure=e).image
        for e in (0, 1)
    ]
    assert (images[0] == 119).all()
    assert LINEAR[images[1][0, 0, 0]] == pytest.approx(2 * LINEAR[119], rel=0.01)


def test_noise_has_the_variance_of_photons():
    """The standard deviation at middle gray is as specified and grows with the square root of the light."""
    from omnisight.simulation import develop
    from omnisight.simulation.texture import to_linear

    rng = np.random.default_rng(0)
    for light in (0.1, 0.2158, 0.6):
        image = develop(np.full((300, 300, 3), light, np.float32), rng, noise=4.0, blur=0)
        assert to_linear(image / 255).std() / (4 / (255 * 1.0752)) == pytest.approx(np.sqrt(light / 0.2158), rel=0.06)
        if light == 0.2158:
            assert image.std() == pytest.approx(4.0, rel=0.03)


# -- rims and files ----------------------------------------------------------------------------------------------


def test_no_light_and_no_ground_truth_outside_the_image_circle():
    camera = om.fisheye(160, 200)
    theta = np.radians((20.0, 80.0))
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    renderer = Renderer(camera, om.Pose(), Scene((shell,)), theta=tuple(theta))
    angle = camera.angle_of(pixels_of(camera))
    seen = (angle > theta[0] + 0.05) & (angle < theta[1] - 0.05)
    dark = (angle < theta[0] - 0.05) | (angle > theta[1] + 0.05) | np.isnan(angle)
    light, truth = renderer.light(), renderer.truth()
    assert light[dark].max() == 0
    assert light[seen].min() > 0.1
    assert (truth.instances[dark] == 0).all()
    assert (truth.instances[seen] == 1).all()
    assert np.isnan(truth.depth[dark]).all()


def test_vignette_darkens_only_the_edge():
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    light = Renderer(om.fisheye(161, 180), om.Pose(), Scene((shell,)), vignette=0.5, theta=(0, np.pi / 2)).light()
    middle, rim = light[80, 80, 0], light[80, 3, 0]
    assert middle == pytest.approx(LINEAR[119])
    assert 0.5 * middle < rim < 0.65 * middle


def test_jpeg_is_similar_but_not_identical():
    camera, scene = om.perspective(70, (160, 120)), still_life()
    plain, packed = (render(camera, scene=scene, noise=0, jpeg=q).image for q in (None, 60))
    assert plain.shape == packed.shape
    assert 0 < np.abs(plain.astype(int) - packed).max() < 60
    with pytest.raises(ValueError, match="jpeg must be from 1 to 100, got 0"):
        render(camera, scene=scene, jpeg=0)
