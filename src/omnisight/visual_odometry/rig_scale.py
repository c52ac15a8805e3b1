"""The scale of the first points, from patches that two cameras of a rig see."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.optim.loss import StudentT, robust_sigma
from omnisight.visual_odometry.ray_observations import FrameRays

Array = NDArray[np.float64]

# Patches that two cameras must see, and the relative standard deviation of the scale above which it is unknown.
MIN_PATCHES, MAX_RELATIVE_SIGMA = 8, 0.1
# Rounds of reweighting.
ROUNDS = 20
# Tails of the residuals: patches of another place.
DEGREES = 2.0


@dataclass(frozen=True)
class RigScale:
    """Metres per unit of the world; false if it is unknown.

    Attributes
    ----------
    scale, relative_sigma
        Value, and standard deviation relative to it.
    patches
        Number of patches that two cameras see.
    """

    scale: float
    relative_sigma: float
    patches: int

    def __bool__(self) -> bool:
        return self.patches >= MIN_PATCHES and 0 < float(self.relative_sigma) < MAX_RELATIVE_SIGMA


def estimate_rig_scale(rays: FrameRays, others: FrameRays, distances: Array) -> RigScale:
    """Estimate the scale of distances from the parallax between two cameras of a rig.

    Seen from another origin o', a point at the distance s d along the bearing b of its ray with the origin o is in the
    direction of b + (o - o') / (s d), which is linear in 1/s.

    Parameters
    ----------
    rays
        (N) of one frame, in metres.
    others
        Rays of some of the patches in further cameras.
    distances
        (N,) distances along the rays, in units of the world; NaN where unknown.
    """
    rows = np.minimum(np.searchsorted(rays.number, others.number), max(len(rays) - 1, 0))
    known = rays.number[rows] == others.number if len(rays) else np.zeros(len(others), np.bool_)
    known &= np.isfinite(distances[rows]) if len(rays) else known
    rows, others = rows[known], others[known]
    if len(rows) < MIN_PATCHES:
        return RigScale(float("nan"), float("nan"), len(rows))
    toward = (rays.origins[rows] - others.origins) / distances[rows, None]
    gains = np.einsum("nij,nj->ni", others.axes, toward)
    values = np.einsum("nij,nj->ni", others.axes, others.bearings - rays.bearings[rows])
    inverse, weights = 0.0, np.ones(len(rows))
    for _ in range(ROUNDS):
        information = float((weights * (gains**2).sum(axis=1)).sum())
        inverse = float((weights * (gains * values).sum(axis=1)).sum()) / max(information, 1e-300)
        squares = ((values - inverse * gains) ** 2).sum(axis=1)
        weights = StudentT(DEGREES, max(robust_sigma(np.sqrt(squares)), 1e-9)).weight(squares)
    sigma = 1.0 / np.sqrt(max(float((weights * (gains**2).sum(axis=1)).sum()), 1e-300))
    if not inverse > 0:
        return RigScale(float("inf"), float("nan"), len(rows))
    return RigScale(1.0 / inverse, float(sigma) / inverse, len(rows))
