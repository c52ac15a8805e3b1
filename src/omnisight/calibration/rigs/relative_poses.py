"""Relative pose of two cameras from the boards that both observe, robust to wrong frames and to half turns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.rigs.poses import Poses
from omnisight.calibration.rigs.sightings import Sightings
from omnisight.display import Displayed
from omnisight.geometry.pose import Pose

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]
Pair = tuple[int, int]

# Share of the simultaneous views that must agree on a relative pose: below, the views are not simultaneous, or the
# cameras moved. A third leaves room for a camera that moved in the middle of the images.
MIN_AGREEING_SHARE = 1 / 3
# Ratio of the residual of a view to that of the agreeing share above which it contradicts the relative pose.
MAX_RESIDUAL_RATIO = 5.0
# Residuals (px, relative to an image 1000 px wide) below which a view never contradicts, because the pose of one board
# has this error in another camera, and above which it always does.
MIN_RESIDUAL_PX, MAX_RESIDUAL_PX = 2.0, 30.0
# Frames from which relative poses are proposed, evenly distributed; each is tried on all frames.
MAX_PROPOSALS = 40


@dataclass(frozen=True, eq=False)
class PairPose(Displayed):
    """The relative pose of two cameras.

    Attributes
    ----------
    b_from_a
        The pose.
    groups
        (F,) simultaneous groups, ascending.
    agrees
        (F,) whether each agrees with the pose.
    turned
        (F,) whether the board of camera b is half a turn from that of camera a, which looks the same.
    residual_px
        (F,) median distance (px) in camera b of the board as posed by camera a from where camera b observed it.
    """

    b_from_a: Pose
    groups: Indices
    agrees: Bools
    turned: Bools
    residual_px: Array

    @property
    def support(self) -> int:
        """Number of groups that agree."""
        return int(self.agrees.sum())


def estimate_pair_pose(a: Sightings, b: Sightings) -> PairPose | None:
    """Estimate the relative pose of two cameras from the groups that both observe; None if there are none.

    Every common group proposes cam_b_from_group @ group_from_cam_a, for a symmetric board also with half a turn in
    between. The proposal with the lowest residual of the best third of all groups is selected: least quantile of
    squares (Rousseeuw and Leroy, Robust Regression and Outlier Detection, 1987).
    """
    groups, at_a, at_b = np.intersect1d(a.group, b.group, return_indices=True)
    if not len(groups):
        return None
    a, b = a.at(at_a), b.at(at_b)
    turned = [np.zeros(len(b), bool)] + ([np.ones(len(b), bool)] if b.is_symmetric else [])
    numberings = [b.turned(which) for which in turned]
    proposed = np.unique(np.linspace(0, len(groups) - 1, MAX_PROPOSALS).round().astype(np.intp))
    quantile = max(int(np.ceil(MIN_AGREEING_SHARE * len(groups))) - 1, 0)
    best: tuple[float, Pose, Array] | None = None
    for numbering in numberings:
        proposals = numbering.cam_from_group[proposed] @ a.cam_from_group[proposed].inverse()
        for k in range(len(proposals)):
            pose = proposals.one(k)
            posed = Poses.of(pose) @ a.cam_from_group
            residuals = np.stack([other.distances(posed) for other in numberings])
            # A view that is compared with the pose it proposed has no residual.
            others = np.delete(residuals.min(0), proposed[k]) if len(groups) > 1 else residuals.min(0)
            score = float(np.partition(others, min(quantile, len(others) - 1))[min(quantile, len(others) - 1)])
            if best is None or score < best[0]:
                best = score, pose, residuals
    assert best is not None
    score, pose, residuals = best
    scale = max(b.size) / 1000
    allowed = scale * np.clip(MAX_RESIDUAL_RATIO * score / scale, MIN_RESIDUAL_PX, MAX_RESIDUAL_PX)
    least = residuals.min(0)
    return PairPose(pose, groups, least <= allowed, residuals.argmin(0) == 1, least)
