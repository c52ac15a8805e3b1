"""Noise of keypoints, in units of their stated standard deviations."""

from dataclasses import replace

import numpy as np

from omnisight.optim.loss import StudentT
from omnisight.parallel import parallel_for
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.linearized_bundle import POINTS_PER_TASK
from omnisight.sfm.structure import Structure


def noise_of_map(bundle: Bundle, structure: Structure) -> StudentT:
    """Return the distribution of the errors of observations: that of residuals corrected for the fitted parameters.

    Points in two images have one residual for four coordinates: without the correction, errors of a normal distribution
    look like those of one with half the standard deviation and heavy tails.
    """
    from omnisight.sfm._noise_kernel import correct_for_points

    is_in_front = np.isfinite(bundle.squared_residuals(structure))
    linearized = bundle.linearize(structure, is_in_front.astype(float))
    squares, dimensions, shares = (np.empty(len(bundle.rays)) for _ in range(3))
    arguments = bundle.starts, linearized.residuals, linearized.by_point
    parallel_for(
        lambda first, last: correct_for_points(*arguments, first, last, squares, dimensions, shares),
        len(structure.points),
        POINTS_PER_TASK,
    )
    fitted = StudentT.fit(np.where(is_in_front, squares, np.inf), dimensions, shares)
    values = 2 * len(bundle.rays) - structure.points.size
    return replace(fitted, sigma=fitted.sigma * float(np.sqrt(values / max(values - bundle.parameters[2], 1))))
