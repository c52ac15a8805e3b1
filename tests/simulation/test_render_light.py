"""Light of the renderer: texture filtering, exposure, noise, image circle, vignette and JPEG."""

import numpy as np
import pytest
from render_cameras import GRAY, POSE, pixels_of, still_life

import omnisight as om
from omnisight.simulation import Renderer, Scene, Texture, box, ellipsoid, render
from omnisight.simulation.procedural_textures import materials
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
    light = Renderer(om.perspective((80, 60), 60), POSE, Scene((shell,)), vignette=0).light()
    assert abs(light.mean() - 0.5) < 0.01
    assert light.std() < 0.06


@pytest.mark.parametrize(("distance", "most"), [(8, 0.06), (17, 0.08), (25, 0.18), (40, 0.25)])
def test_bricks_at_four_rays_match_many_rays(distance, most):
    """Moire is the difference from 144 rays per pixel, relative to the contrast; courses are 1 to 5 px high."""
    wall = Texture(materials.bricks(np.random.default_rng(0), 20, 10, (158, 92, 72), 150))
    scene = Scene((box((-10, -5, distance), (10, 5, distance + 0.1), wall, "wall", glow=1.0),))
    camera, pose = om.perspective((120, 100), 20), om.Pose(om.look(yaw=3).T, np.zeros(3))
    few, many = (
        Renderer(camera, pose, scene, samples=n, vignette=0).light()[15:85, :, 1].astype(float) for n in (2, 12)
    )
    assert np.std(few - many) < most * np.std(many)
    assert np.std(few) == pytest.approx(np.std(many), rel=0.08)


def test_joints_cover_each_pixel_by_their_exact_share():
    """All rows of joints have the same total, wherever they fall on the pixel grid."""
    share = materials.joint_share(704, 7.04, 0.14)
    fine = materials.joint_share(704 * 50, 7.04 * 50, 0.14).reshape(704, 50).mean(1)
    np.testing.assert_allclose(share, fine, atol=1e-5)
    assert share.mean() == pytest.approx(0.14, abs=1e-6)
    joints = [share[round(k * 7.04 - 1) : round(k * 7.04 + 3)].sum() for k in range(1, 99)]
    np.testing.assert_allclose(joints, 0.14 * 7.04, atol=1e-4)


def test_repeated_texture_renders_as_its_copies():
    rng = np.random.default_rng(0)
    tile = rng.integers(0, 255, (16, 16, 3)).astype(np.uint8)
    tile = np.concatenate([tile, tile[:, ::-1]], 1)
    tile = np.concatenate([tile, tile[::-1]])  # continues seamlessly
    images = []
    for texture in (Texture(tile, (4, 2)), Texture(np.tile(tile, (2, 4, 1)))):
        scene = Scene((box((-2, -1, 3), (2, 1, 3.1), texture, "wall", glow=1.0),))
        images.append(Renderer(om.perspective((120, 90), 60), om.Pose(), scene, vignette=0).light())
    np.testing.assert_allclose(images[0], images[1], atol=2e-2)


def test_exposure_doubles_the_light_per_stop():
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    images = [
        render(om.perspective((20, 16), 60), scene=Scene((shell,)), vignette=0, noise=0, exposure=e).image
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


def gray_light(camera, **options):
    """Return the light of a uniform scene, relative to its own."""
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    return Renderer(camera, om.Pose(), Scene((shell,)), **options).light()[..., 0] / LINEAR[119]


@pytest.mark.parametrize("camera", [om.perspective((161, 121), 90), om.fisheye(161, 180), om.perspective((90, 90), 30)])
def test_every_lens_loses_the_same_share_of_light_at_the_edge_of_its_image(camera):
    light = gray_light(camera, vignette=0.4, samples=1)
    seen = light > 0
    height, width = light.shape
    assert light[height // 2, width // 2] == pytest.approx(1, abs=1e-3)
    assert light[seen].min() == pytest.approx(0.6, abs=0.02)


@pytest.mark.parametrize("panorama", [om.sphere(128), om.sphere(128, azimuth=(-60, 60)), om.cylinder(128)])
def test_panoramas_have_no_vignetting(panorama):
    assert gray_light(panorama, vignette=0.4) == pytest.approx(1, abs=1e-6)


def test_vignetting_of_a_mirror_camera_is_that_of_its_lens():
    from omnisight.pipeline.calibration.design import DesignOptions, design

    camera = design(DesignOptions(kind="spherical", sensor=(161, 121), pixel=30e-6)).camera
    renderer = Renderer(camera, om.Pose(), Scene(()), theta=(camera.theta_min, camera.theta_max), vignette=0.4)
    share = renderer.vignetting()
    shown = share > 0.5
    rows, columns = np.nonzero(shown)
    radius = np.hypot(columns - 80, rows - 60)
    expected = 1 - 0.4 * (radius / 58.8) ** 4
    inside = (radius < 56) & (radius > 20)
    assert inside.sum() > 5000
    np.testing.assert_allclose(share[shown][inside], expected[inside], atol=0.02)


def test_vignetting_is_the_ratio_of_light_with_and_without_it():
    camera = om.fisheye(81, 180)
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    renderer = Renderer(camera, om.Pose(), Scene((shell,)), theta=(0.3, 1.4), vignette=0.5)
    np.testing.assert_allclose(renderer.light()[..., 1], renderer.vignetting() * LINEAR[119], atol=1e-6)


def test_vignette_darkens_only_the_edge():
    shell = box((-3, -3, -3), (3, 3, 3), GRAY, "shell", inside=True, glow=1.0)
    light = Renderer(om.fisheye(161, 180), om.Pose(), Scene((shell,)), vignette=0.5, theta=(0, np.pi / 2)).light()
    middle, rim = light[80, 80, 0], light[80, 3, 0]
    assert middle == pytest.approx(LINEAR[119])
    assert 0.5 * middle < rim < 0.65 * middle


def test_jpeg_is_similar_but_not_identical():
    camera, scene = om.perspective((160, 120), 70), still_life()
    plain, packed = (render(camera, scene=scene, noise=0, jpeg=q).image for q in (None, 60))
    assert plain.shape == packed.shape
    assert 0 < np.abs(plain.astype(int) - packed).max() < 60
    with pytest.raises(ValueError, match="jpeg must be from 1 to 100, got 0"):
        render(camera, scene=scene, jpeg=0)
