"""The part of the code of visual odometry that its first run compiles in another process."""

import numpy as np

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions, ransac
from omnisight.optim.refinement import THRESHOLDS, refine
from omnisight.twoview import first_run as of_two_views
from omnisight.twoview.triangulation import whitening

PARTS = "omnisight.visual_odometry.first_run:fit_models", *of_two_views.PARTS[1:]


def parts() -> tuple[str, ...]:
    """Return what is compiled while this process compiles the tracking; nothing if that is stored.

    For `compile_in_parallel`.
    """
    from omnisight.compiled import has_code
    from omnisight.visual_odometry._patch_alignment_kernel import align

    return () if has_code(align) else PARTS


def fit_models() -> None:
    """Fit the rotation of a tracked camera, the models of two views, and the pose of a camera that sees points."""
    from omnisight.twoview._alignment_problems_kernel import RotationProblem
    from omnisight.visual_odometry._ray_pose_kernel import RayPoseProblem

    pairs = of_two_views.example_pairs()
    refine(RotationProblem.of(pairs), Pose().matrix)
    of_two_views.fit_models()
    points, origins = of_two_views.example_points(), np.zeros_like(pairs.b)
    problem = RayPoseProblem(points, origins, pairs.b, whitening(pairs.covariance_b), pairs.variance)
    refine(problem, of_two_views.B_FROM_A.matrix)
    ransac(problem, THRESHOLDS[2], RansacOptions())
