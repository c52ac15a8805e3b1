"""Parts of the code of poses that the first run of a command compiles in other processes."""

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.block_jackknife import variance_ratio
from omnisight.optim.ransac import RansacOptions, ransac
from omnisight.optim.refinement import THRESHOLDS, refine
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.twoview.triangulation import triangulate

Array = NDArray[np.float64]

PARTS = "omnisight.twoview.first_run:fit_models", "omnisight.twoview.first_run:search_relative_pose"

B_FROM_A = Pose(translation=np.array([1.0, 0.0, 0.0]))


def parts() -> tuple[str, ...]:
    """Return what is compiled while this process compiles the search of relative poses; nothing if that is stored.

    For `compile_in_parallel`.
    """
    from omnisight.compiled import has_code
    from omnisight.optim._robust_problem_kernel import linearized

    return () if has_code(linearized) else PARTS


def fit_models() -> None:
    """Fit all that may explain pairs of bearings, triangulate points, and fit an absolute pose to them."""
    from omnisight.twoview._absolute_pose_kernel import AbsolutePoseProblem
    from omnisight.twoview._alignment_problems_kernel import HomographyProblem, RotationProblem
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    pairs = example_pairs()
    problem = RelativePoseProblem.of(pairs)
    refine(problem, B_FROM_A.matrix)
    for other in (RotationProblem, HomographyProblem):
        ransac(other.of(pairs), THRESHOLDS[2], RansacOptions())
    variance_ratio(problem, B_FROM_A.matrix, pairs.a)
    triangulate([Pose(), B_FROM_A], [pairs.a, pairs.b])
    refine(AbsolutePoseProblem(example_points(), pairs.b, pairs.covariance_b, pairs.variance), B_FROM_A.matrix)


def search_relative_pose() -> None:
    """Search a relative pose: the longest compilation."""
    from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

    ransac(RelativePoseProblem.of(example_pairs()), THRESHOLDS[1], RansacOptions())


def example_points() -> Array:
    """Return points (N, 3) around the cameras."""
    return np.random.default_rng(0).uniform(-5.0, 5.0, (100, 3))


def example_pairs() -> BearingPairs:
    """Return the bearings of the points."""
    points = example_points()
    a, b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (points, points + B_FROM_A.translation))
    return BearingPairs.of(a, b, None, None, 0.05)
