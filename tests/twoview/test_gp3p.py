"""The absolute pose of rays with several origins, beyond the laws of all minimal solvers."""

import numpy as np
from motions import absolute_pose

from omnisight.twoview import gp3p, p3p


def test_rays_with_a_common_origin_have_the_solutions_of_p3p():
    origin = np.array([0.3, -2.0, 1.0])
    found = 0
    for seed in range(100):
        points, bearings, _ = absolute_pose(np.random.default_rng(seed))
        central, general = p3p(points, bearings), gp3p(points, np.tile(origin, (3, 1)), bearings)
        central[:, :, 3] += origin
        assert len(central) == len(general)
        assert np.abs(central[:, None] - general).max((2, 3)).min(1).max() < 1e-6
        found += len(central)
    assert found > 100
