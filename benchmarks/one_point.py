"""One-point RANSAC of a car against five-point RANSAC, on rendered images of a car that drives through the town.

`python -m benchmarks one_point` prints a table. Keypoints of consecutive images are matched, and some of the matches
exchanged until a share of them is wrong. Both methods have the same matches, noise, scoring and refinement of all five
degrees of freedom; only the samples differ. At least 50 samples are always drawn.
"""

import argparse
import time
from itertools import pairwise
from typing import NamedTuple

import numpy as np

import omnisight as om
from benchmarks.motion import RenderedSequence, render
from omnisight.geometry import rotation as so3
from omnisight.optim.ransac import RansacOptions
from omnisight.optim.robust_estimation import estimate_robustly
from omnisight.simulation.trajectory import read_trajectory
from omnisight.twoview._relative_pose_kernel import RelativePoseProblem
from omnisight.twoview.bearing_pairs import BearingPairs
from omnisight.visual_odometry.car_motion import estimate_car_motion

SEQUENCE = RenderedSequence("town", "fisheye", 60, 800)
SHARES = (0.3, 0.5, 0.7, 0.85)
SIGMA_DEG = 0.1
CONFIDENCE = 0.99
STEP = 2
KEYPOINTS = 500


class Trial(NamedTuple):
    """Samples drawn, milliseconds, and errors of the rotation and of the direction, degrees; inf if it failed."""

    iterations: float
    milliseconds: float
    rotation: float
    direction: float


def matched(folder):
    """Return for pairs of consecutive images the bearings of matches, and the true relative pose."""
    camera, poses = om.load(folder / "camera.json"), read_trajectory(folder / "poses.txt").poses
    files = sorted((folder / "images").iterdir())
    options = om.FeatureOptions(max_keypoints=KEYPOINTS)
    keypoints = [om.detect_features(om.read_image(path), camera, options) for path in files[::STEP]]
    for k, (first, second) in enumerate(pairwise(keypoints)):
        pairs = om.match_features(first, second).pairs
        truth = poses[STEP * (k + 1)].inverse() @ poses[STEP * k]
        if np.linalg.norm(truth.translation) > 0.1:
            yield first.bearings[pairs[:, 0]], second.bearings[pairs[:, 1]], truth


def with_outliers(a, b, truth, share, rng):
    """Return matches of which a share is wrong: the others agree with the true pose."""
    normal = np.cross(truth.translation, a @ truth.rotation.T)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    good = np.abs((normal * b).sum(axis=1)) < np.radians(3 * SIGMA_DEG)
    a, b = a[good], b[good].copy()
    wrong = rng.permutation(len(a))[: round(share * len(a))]
    b[wrong] = np.roll(b[wrong], 1, axis=0)
    return BearingPairs.of(a, b, None, None, SIGMA_DEG)


def trial(method, pairs, truth, seed):
    """Run a method once."""
    options = RansacOptions(confidence=CONFIDENCE, seed=seed)
    start = time.process_time()
    if method == "one point":
        found = estimate_car_motion(pairs, np.eye(3), options)
    else:
        found = estimate_robustly(
            lambda s: RelativePoseProblem.of(pairs.scaled(s)), is_scale_known=True, options=options
        )
    milliseconds = 1e3 * (time.process_time() - start)
    if found.model is None:
        return Trial(found.iterations, milliseconds, np.inf, np.inf)
    turn = np.degrees(np.linalg.norm(so3.log(found.model[:, :3] @ truth.rotation.T)))
    cosine = found.model[:, 3] @ truth.translation / np.linalg.norm(truth.translation)
    return Trial(found.iterations, milliseconds, float(turn), float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))))


def main(arguments):
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks one_point", description=__doc__)
    parser.parse_args(arguments)
    scenes = list(matched(render(SEQUENCE)))
    needed = {1: "one point", 5: "five points"}
    print("| outliers | samples | needed for 99 % | drawn | time | rotation error | direction error | failed |")
    print("|---|---|---|---|---|---|---|---|")
    for share in SHARES:
        rng = np.random.default_rng(0)
        problems = [(with_outliers(a, b, truth, share, rng), truth) for a, b, truth in scenes]
        for size, name in needed.items():
            trial(name, *problems[0], 0)
            trials = [trial(name, pairs, truth, k) for k, (pairs, truth) in enumerate(problems)]
            failed = sum(not each.direction < 5 for each in trials)
            count = int(np.ceil(np.log(1 - CONFIDENCE) / np.log1p(-((1 - share) ** size))))
            drawn, milliseconds, turn, direction = np.median(trials, axis=0)
            figures = f"{drawn:.0f} | {milliseconds:.1f} ms | {turn:.3f}° | {direction:.2f}°"
            print(f"| {share:.0%} | {name} | {count} | {figures} | {failed} of {len(trials)} |", flush=True)
