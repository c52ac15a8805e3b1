"""A map of points with known positions."""

import numpy as np
import pytest

import omnisight as om
from localization.known_points import SIGMA_POINT, SPHERE, descriptors_of, unit
from omnisight.geometry import rotation as so3
from omnisight.sfm.reconstruction import PointObservations, Points, Reconstruction


@pytest.fixture(scope="module")
def world():
    """Return a map of 400 points around six panoramas, and its points."""
    rng = np.random.default_rng(0)
    points = unit(rng.normal(size=(400, 3))) * rng.uniform(2, 4, (400, 1))
    poses = [om.Pose(so3.exp(rng.normal(0, 0.5, 3)), rng.normal(0, 0.4, 3)) for _ in range(6)]
    image, point = np.repeat(np.arange(6), 400), np.tile(np.arange(400), 6)
    pixels = np.concatenate([SPHERE.project(pose @ points)[0] for pose in poses])
    model = Reconstruction(
        om.Rig((SPHERE,), (om.Pose(),), ("camera",)),
        tuple(f"{k}.jpg" for k in range(6)),
        np.zeros(6, int),
        np.arange(6),
        tuple(poses),
        np.zeros((6, 6, 6)),
        Points(points, np.tile(SIGMA_POINT**2 * np.eye(3), (400, 1, 1)), np.zeros((400, 3), np.uint8)),
        PointObservations(image, point, pixels, np.zeros((2400, 2))),
    )
    return om.VisualMap(model, descriptors_of(point, rng)), points
