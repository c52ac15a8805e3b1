"""Noise of keypoints, in units of their stated standard deviations: by the residuals of maps and of pairs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.loss import NORMAL_MEDIAN, StudentT
from omnisight.parallel import parallel_map
from omnisight.sfm.bundle_adjustment import Bundle
from omnisight.sfm.rig_images import RigImages
from omnisight.sfm.structure import Structure
from omnisight.sfm.view_graph import Edge
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]


def noise_of_map(bundle: Bundle, structure: Structure) -> StudentT:
    """Return the distribution of the whitened residuals, corrected for the parameters that were fitted to them."""
    fitted = StudentT.fit(bundle.squared_residuals(structure))
    values = 2 * len(bundle.rays)
    freedom = values - structure.points.size - bundle.parameters[2]
    return replace(fitted, sigma=fitted.sigma * float(np.sqrt(values / max(freedom, 1))))


def noise_of_pairs(edges: Sequence[Edge], images: RigImages) -> float:
    """Return the median over edges of the standard deviation of the epipolar residuals; 0 without a translation.

    Each pair of images has a relative pose of its own, so that errors of the map are no part of these residuals.
    """

    def of_edge(edge: Edge) -> float:
        from omnisight.optim._robust_problem_kernel import squared_residuals
        from omnisight.twoview._relative_pose_kernel import RelativePoseProblem

        a, b = (images.offsets[image] + edge.pairs[:, side] for side, image in enumerate(edge.images))
        covariance_a, covariance_b = (_covariances(images.axes[each]) for each in (a, b))
        pairs = BearingPairs.of(images.bearings[a], images.bearings[b], covariance_a, covariance_b, None)
        squares = squared_residuals(RelativePoseProblem.of(pairs), edge.b_from_a.matrix)
        return float(np.sqrt(np.median(squares))) / NORMAL_MEDIAN

    moving = [edge for edge in edges if edge.has_translation]
    return float(np.median(parallel_map(of_edge, moving))) if moving else 0.0


def _covariances(axes: Array) -> Array:
    """Return the covariances (N, 3, 3) of bearings whose whitened components are those along axes (N, 2, 3)."""
    transposed = axes.transpose(0, 2, 1)
    inverse = np.linalg.inv(axes @ transposed)
    return transposed @ inverse @ inverse @ axes
