"""The solutions of the minimal solvers are those of PoseLib, also for bearings behind the camera."""

import numpy as np
import pytest
from motions import SUBJECTS

SAMPLES = 500
# PoseLib misses or adds solutions near double roots, and 1 % of its five-point solutions are wrong by more than 1e-6.
MAX_DIFFERENT = 0.01
TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def poselib():
    return pytest.importorskip("poselib")


SOLVERS = {
    "five_point": lambda poselib, a, b: poselib.relpose_5pt(a, b),
    "upright_three_point": lambda poselib, a, b: poselib.relpose_upright_3pt(a, b),
    "planar_two_point": lambda poselib, a, b: poselib.relpose_upright_planar_2pt(a, b),
    "upright_p2p": lambda poselib, points, bearings: poselib.up2p(bearings, points),
    "gp3p": lambda poselib, points, rays: poselib.gp3p(rays[:, :3], rays[:, 3:], points),
    "p3p": lambda poselib, points, bearings: poselib.p3p(bearings, points),
}


@pytest.mark.peer
@pytest.mark.parametrize("name", SOLVERS)
def test_the_solutions_are_those_of_poselib(poselib, name):
    subject = SUBJECTS[name]
    different = 0
    for seed in range(SAMPLES):
        a, b, _ = subject.sample(np.random.default_rng(seed))
        poses = subject.solve(a, b)
        # The upright solvers of PoseLib do not test whether the distances are positive.
        peers = [pose.Rt for pose in SOLVERS[name](poselib, a, b)]
        peers = np.array([pose for pose in peers if subject.residuals(pose, a, b).max() < 0.1]).reshape(-1, 3, 4)
        errors = np.abs(poses[:, None] - peers[None]).max((2, 3), initial=0)
        same = len(poses) == len(peers) > 0 and errors.min(0).max() < TOLERANCE and errors.min(1).max() < TOLERANCE
        different += not same
    assert different <= MAX_DIFFERENT * SAMPLES
