"""The relative pose of rigs, beyond the laws of all minimal solvers."""

import numpy as np
import pytest
from motions import random_rotation, unit

from omnisight.twoview import seventeen_point


def rays_of_cameras(rng, count, rotation, translation):
    """Return the rays of a rig of four cameras, each of which sees its own points only, at two times."""
    origins = rng.normal(size=(4, 3))[np.arange(count) % 4]
    a = unit(rng.normal(size=(count, 3)))
    points = origins + a * rng.uniform(1, 8, (count, 1))
    return origins, a, origins, unit(points @ rotation.T + translation - origins)


@pytest.mark.parametrize("count", [17, 100])
def test_the_scale_of_cameras_that_see_no_points_of_each_other_is_found(count):
    for seed in range(50):
        rng = np.random.default_rng(seed)
        rotation, translation = random_rotation(rng), rng.normal(size=3)
        (pose,) = seventeen_point(*rays_of_cameras(rng, count, rotation, translation))
        np.testing.assert_allclose(pose, np.column_stack([rotation, translation]), rtol=0, atol=1e-6)


def test_noise_is_averaged_over_many_rays():
    rng = np.random.default_rng(1)  # turns by 171 degrees; the scale is uncertain for small rotations
    rotation, translation = random_rotation(rng), unit(rng.normal(size=3))
    origins_a, a, origins_b, b = rays_of_cameras(rng, 2000, rotation, translation)
    (pose,) = seventeen_point(origins_a, a, origins_b, unit(b + 1e-3 * rng.normal(size=b.shape)))
    assert np.abs(pose[:, :3] - rotation).max() < 1e-3
    assert np.abs(pose[:, 3] - translation).max() < 1e-3
