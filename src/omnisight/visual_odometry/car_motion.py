"""Relative pose of a camera on a car, from hypotheses of one pair of bearings."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import RobustEstimate, estimate_robustly
from omnisight.twoview.bearing_pairs import BearingPairs

Array = NDArray[np.float64]


def estimate_car_motion(pairs: BearingPairs, vehicle_from_rig: Array, options: RansacOptions) -> RobustEstimate:
    """Estimate the relative pose of a camera on a car from pairs of bearings.

    Over a short way a car drives on an arc of a circle, so one pair determines the motion up to its length (D.
    Scaramuzza, 1-point-RANSAC structure from motion for vehicle-mounted cameras by exploiting non-holonomic
    constraints, IJCV 95, 2011). The model is refined without this constraint: cars pitch, roll and slip, and the camera
    is not above the rear axle.

    Parameters
    ----------
    pairs
        The bearings in the frame of the rig.
    vehicle_from_rig
        Rotation (3, 3) to the axes of the vehicle: y down, z ahead.
    options
        Options of the search.

    Returns
    -------
    The estimate, whose model is `b_from_a` in the frame of the rig; its covariance is not known there.
    """
    from omnisight.visual_odometry._circular_motion_kernel import CircularMotionProblem

    v = vehicle_from_rig
    covariances = (v @ covariance @ v.T for covariance in (pairs.covariance_a, pairs.covariance_b))
    turned = BearingPairs(pairs.a @ v.T, pairs.b @ v.T, *covariances, is_noise_known=pairs.is_noise_known)
    found = estimate_robustly(
        lambda scale: CircularMotionProblem.of(turned.scaled(scale)),
        is_scale_known=pairs.is_noise_known,
        options=options,
    )
    if found.model is None:
        return found
    axes = Pose(v)
    model = (axes.inverse() @ Pose.of_matrix(found.model) @ axes).matrix
    return replace(found, model=model, covariance=np.full_like(found.covariance, np.nan))
