"""Relative pose of a car by one pair of bearings, with outliers and a motion that is not exactly an arc."""

import numpy as np
import pytest

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.optim.ransac import RansacOptions
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.visual_odometry.car_motion import estimate_car_motion


def directions(points):
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("up", ["top", "back"])
@pytest.mark.parametrize("outliers", [0.0, 0.6])
def test_a_car_that_pitches_is_found_among_outliers(up, outliers):
    rng = np.random.default_rng(0)
    vehicle_from_rig = om.look(up=up)
    half = np.radians(2.0)
    # The car turns right by 4 degrees, and pitches by 0.3 degrees; x right, y down, z ahead.
    rotation = so3.exp(np.radians([0.3, 0.0, 0.0])) @ so3.exp(np.array([0.0, -2 * half, 0.0]))
    translation = np.array([np.sin(half), 0.0, -np.cos(half)])
    a = directions(rng.normal(size=(200, 3))) * rng.uniform(3, 20, (200, 1))
    b = a @ rotation.T + translation
    b = directions(b) + np.radians(0.05) * rng.normal(size=b.shape)
    wrong = rng.random(200) < outliers
    b[wrong] = rng.normal(size=(int(wrong.sum()), 3))
    pairs = BearingPairs.of(a @ vehicle_from_rig, directions(b) @ vehicle_from_rig, None, None, 0.05)
    found = estimate_car_motion(pairs, vehicle_from_rig, RansacOptions())
    assert found.model is not None
    turn = vehicle_from_rig @ found.model[:, :3] @ vehicle_from_rig.T
    assert np.degrees(np.linalg.norm(so3.log(turn @ rotation.T))) < 0.05
    assert vehicle_from_rig @ found.model[:, 3] @ translation > np.cos(np.radians(0.5))
    assert (found.inliers & wrong).sum() < 0.1 * max(wrong.sum(), 1) + 1
