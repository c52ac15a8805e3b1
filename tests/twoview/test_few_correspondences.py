"""Estimates from few correspondences, with several optima."""

import numpy as np

from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.twoview._relative_pose_kernel import RelativePoseProblem
from omnisight.twoview.bearing_pairs import BearingPairs

# Matches of two images of a rendered street: bearings a and b, 1e-4, and their standard deviations, 1e-6 rad.
STREET = np.array(
    [
        [1094, 765, 9911, 1114, 694, 9914, 674, 658],
        [-253, -2665, 9635, -272, -2860, 9579, 1208, 1199],
        [631, -3869, 9199, 769, -4075, 9100, 3179, 3317],
        [8884, -2507, 3846, 7799, -5448, 3082, 697, 1706],
        [8958, -1982, 3978, 6824, -6706, 2908, 762, 1402],
        [308, 1575, 9870, -2494, -152, 9683, 861, 701],
        [-461, -4080, 9118, -484, -4265, 9032, 1406, 1464],
        [-1324, -4843, 8648, -1318, -5007, 8555, 2092, 2029],
        [-197, -3784, 9254, -249, -3982, 9170, 1767, 1460],
        [-1578, -3426, 9261, -1600, -3611, 9187, 1149, 1216],
        [1363, -3704, 9188, 1362, -3885, 9113, 763, 801],
        [1279, -3490, 9283, 1289, -3684, 9207, 918, 851],
        [-987, -4237, 9004, -994, -4424, 8913, 873, 921],
        [-1019, -3666, 9248, -1062, -3861, 9163, 895, 892],
        [-1086, -4637, 8793, -1081, -4811, 8700, 813, 820],
        [1243, -5255, 8417, 1277, -5416, 8309, 1142, 1378],
        [-318, -2286, 9730, -315, -2468, 9685, 690, 767],
        [-2056, -5178, 8304, -2078, -5334, 8200, 1917, 1928],
        [-2260, -5078, 8313, -2257, -5254, 8204, 1223, 1047],
        [-598, -4486, 8917, -582, -4651, 8833, 1911, 1823],
    ],
    float,
)


def isotropic(bearings, sigma):
    """Return covariances (N, 3, 3) of bearings (N, 3) whose standard deviations (N,) are equal in all directions."""
    return sigma[:, None, None] ** 2 * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])


def test_the_most_probable_model_is_not_one_that_no_correspondence_agrees_with():
    """The search for homographies of its inliers did not end."""
    a, b = (side / np.linalg.norm(side, axis=1, keepdims=True) for side in (STREET[:, :3], STREET[:, 3:6]))
    covariances = isotropic(a, 1e-6 * STREET[:, 6]), isotropic(b, 1e-6 * STREET[:, 7])
    pairs = BearingPairs.of(a, b, *covariances, None)
    found = estimate_robustly(
        lambda scale: RelativePoseProblem.of(pairs.scaled(scale)),
        is_scale_known=False,
        options=RansacOptions(max_iterations=5000),
    )
    assert found.model is None or found.inliers.sum() > 5
