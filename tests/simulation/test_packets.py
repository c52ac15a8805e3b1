"""Rays traced as packets have the hits, shadows and images of single rays."""

import numpy as np
import pytest
from render_cameras import GRAY

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import Renderer, Scene, box, cylinder, ellipsoid, rectangle, roof

CAMERA = om.perspective((48, 32), 80)


@pytest.fixture(scope="module")
def clutter():
    """Return many solids of all shapes, some of them coincident, under a sun."""
    rng = np.random.default_rng(0)
    solids = [rectangle((-20, 1.6, 20), (40, 0, 0), (0, 0, -40), GRAY, "ground")]
    for i in range(60):
        low = rng.uniform((-6, -3, 3), (6, 1, 15))
        size = rng.uniform(0.1, 1.5, 3)
        shapes = (
            box(low, low + size, GRAY, f"box {i}"),
            ellipsoid(low, size, GRAY, f"ellipsoid {i}"),
            cylinder(low, low + size, 0.2, GRAY, f"cylinder {i}"),
            roof(low, low + size, GRAY, f"roof {i}"),
        )
        solids.append(shapes[i % 4].moved(om.Pose(exp(rng.normal(0, 0.2, 3)))))
    return Scene((*solids, *solids[1:6]), sun=((0.4, -0.7, -0.3), 0.8), ambient=0.5, spacing=0.6)


@pytest.mark.parametrize("parallel", [False, True], ids=["central", "parallel"])
def test_neighbouring_rays_hit_what_single_rays_hit(clutter, parallel):
    """Rays in random order are no packets."""
    pixels = np.stack(np.meshgrid(np.arange(48.0), np.arange(32.0)), -1).reshape(-1, 2)
    bearings = CAMERA.rays(pixels).bearings
    origins = np.zeros_like(bearings)
    if parallel:
        origins, bearings = 4 * bearings - (0, 0, 4), np.tile((0.0, 0.0, 1.0), (len(bearings), 1))
        bearings[::2] = (0.01, 0.02, 1.0)
        bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    bearings[5::97] = np.nan
    order = np.random.default_rng(0).permutation(len(bearings))
    found, mixed = clutter.cast(origins, bearings), clutter.cast(origins[order], bearings[order])
    assert len(set(found.instances.tolist())) > 12
    for a, b in zip(found, mixed, strict=True):
        np.testing.assert_allclose(a[order], b, atol=1e-9)
    assert not found.instances[5::97].any()


def test_images_of_packets_are_the_mean_of_images_of_single_rays(clutter):
    """One ray per pixel, from each of the four places in the pixel, in an image without texture."""

    class Shifted:
        size = CAMERA.size

        def __init__(self, shift):
            self.shift = shift

        def rays(self, pixels):
            return CAMERA.rays(np.asarray(pixels) + self.shift)

        def project(self, points):
            pixels, valid = CAMERA.project(points)
            return pixels - self.shift, valid

    quarter = [(u, v) for v in (-0.25, 0.25) for u in (-0.25, 0.25)]
    single = [Renderer(Shifted(shift), om.Pose(), clutter, samples=1, vignette=0).light() for shift in quarter]
    packets = Renderer(CAMERA, om.Pose(), clutter, samples=2, vignette=0).light()
    np.testing.assert_allclose(packets, np.mean(single, axis=0), atol=1e-5)
    assert packets.std() > 0.05


def test_rays_of_rolling_shutters_and_rigs_in_motion(clutter):
    """Each row has its own pose: the image is made of rows of still images."""
    rows = [om.Pose(exp((0, 0.002 * v, 0)), np.array((0.01 * v, 0, 0))) for v in range(32)]
    rolling = Renderer(CAMERA, rows, clutter, samples=2, vignette=0).light()
    for v in (0, 15, 31):
        still = Renderer(CAMERA, rows[v], clutter, samples=2, vignette=0).light()
        np.testing.assert_allclose(rolling[v], still[v], atol=1e-6)
