"""Recognition of places of a town at another visit: other headings and light, other parked cars, equal house fronts.

Panoramas are rendered along the loop of the town, and queries between them: on the same lane, and on the other one,
which is driven in the other direction. Queries are of the evening, and other cars are parked.
"""

import importlib.util
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.places_scenes import CAMERA, OTHER_LANE, regular
from benchmarks.rendered_images import image_cache
from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.geometry.pose import Pose
from omnisight.places.verification import verify_place
from omnisight.simulation import Renderer, Scene, scene_named
from omnisight.simulation.daylight import Daylight, with_daylight
from omnisight.simulation.preset_motion import preset_trajectory

Array = NDArray[np.float64]

REFERENCES, QUERIES = 80, 24
# Evening, with an exposure for it, and another visit.
EVENING, EVENING_EXPOSURE, VISIT = Daylight(time=17.5), 1.0, 1
# Distance (metres) within which an image shows the same place: that of the lanes, and a spacing of the references.
MAX_DISTANCE_M = 7.0
# Images that are verified for each query.
CANDIDATES = 5


def route(count: int, offset: float) -> list[Pose]:
    """Return poses at regular distances along the loop of the town, shifted by a share of the spacing."""
    scene = _scene("reference")
    return regular(preset_trajectory("loop", scene.free, 0.0, scene.route).poses, count, offset)


def image_sets() -> dict[str, list[Pose]]:
    """Return the poses of the references and of the sets of queries."""
    queries = route(QUERIES, 0.37)
    return {"reference": route(REFERENCES, 0.0), "same": queries, "other": [pose @ OTHER_LANE for pose in queries]}


@cache
def _scene(name: str) -> Scene:
    """Return the town at the visit of a set."""
    town = scene_named("town")
    return town if name == "reference" else with_daylight(town.with_visit(VISIT), EVENING)


def keypoints_of(name: str, poses: Sequence[Pose]) -> list[Keypoints]:
    """Render a set, or read it from the cache, and detect keypoints."""
    folder = image_cache("places") / f"visits-{name}"
    folder.mkdir(parents=True, exist_ok=True)
    found = list[Keypoints]()
    for i, pose in enumerate(poses):
        path = folder / f"{i:04d}.png"
        if not path.exists():
            exposure = 0.0 if name == "reference" else EVENING_EXPOSURE
            renderer = Renderer(CAMERA, pose, _scene("reference" if name == "reference" else "evening"))
            om.write_image(path, renderer(rng=np.random.default_rng(i), exposure=exposure).image)
        found.append(detect_features(om.read_image(path), CAMERA, FeatureOptions()))
    return found


def ranked_by_peer(references: Sequence[Keypoints], queries: Sequence[Keypoints]) -> list[list[int]] | None:
    """Return the references in the order of their similarity by COLMAP's vocabulary tree; None without pycolmap."""
    if importlib.util.find_spec("pycolmap") is None:
        return None
    every = {f"d{i}": keypoints.descriptors for i, keypoints in enumerate((*references, *queries))}
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.json"
        np.savez(source, references=len(references), queries=len(queries), pixels=np.array(CAMERA.size), **every)
        command = [sys.executable, "-m", "benchmarks.places_peer", str(source), str(target)]
        subprocess.run(command, check=True, capture_output=True)
        return json.loads(target.read_text())


def recall_and_precision(score: Array, is_correct: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return recall and precision (N,) of the queries with the highest scores (N,), the highest first."""
    correct = np.cumsum(is_correct[np.argsort(-score, kind="stable")])
    return correct / len(score), correct / np.arange(1, len(score) + 1)


def print_visits() -> None:
    """Print the table: how often the first place is right, and recall and precision of scores."""
    poses = image_sets()
    keypoints = {name: keypoints_of(name, each) for name, each in poses.items()}
    index = om.PlaceIndex()
    for each in keypoints["reference"]:
        index.add(each)
    at = np.array([pose.translation for pose in poses["reference"]])
    print("\n| queries | score | first is right | recall at 100 % precision | at 95 % | average precision |")
    print("|---|---|---|---|---|---|")
    for name in ("same", "other"):
        eyes = np.array([pose.translation for pose in poses[name]])
        is_near = np.linalg.norm(eyes[:, None] - at, axis=2) < MAX_DISTANCE_M
        similar = [index.query(each, CANDIDATES) for each in keypoints[name]]
        rows = [[place.image for place in places] for places in similar]
        print(_row(name, "`PlaceIndex`", np.array([places[0].score for places in similar]), rows, is_near))
        verified = [
            [verify_place(query, keypoints["reference"][row]) for row in candidates]
            for query, candidates in zip(keypoints[name], rows, strict=True)
        ]
        best = [max(range(len(each)), key=lambda k, each=each: each[k].inliers) for each in verified]
        first = [[row[k]] for row, k in zip(rows, best, strict=True)]
        chosen = [each[k] for each, k in zip(verified, best, strict=True)]
        print(_row(name, "inliers of `verify_place`", np.array([float(m.inliers) for m in chosen]), first, is_near))
        print(_row(name, "its directions", np.array([m.directions for m in chosen]), first, is_near), flush=True)
        ranked = ranked_by_peer(keypoints["reference"], keypoints[name])
        if ranked is None:
            print(f"| {name} | pycolmap is missing | | | | |")
        else:
            right = np.mean([is_near[i, each[0]] for i, each in enumerate(ranked)])
            print(f"| {name} | COLMAP's vocabulary tree, without scores | {right:.0%} | | | |", flush=True)


def _row(name: str, method: str, score: Array, rows: Sequence[Sequence[int]], is_near: NDArray[np.bool_]) -> str:
    """Return the row of a method that scores the first of the images (rows) of each query."""
    is_right = np.array([is_near[i, each[0]] for i, each in enumerate(rows)])
    recall, precision = recall_and_precision(score, is_right)
    at = [recall[precision >= limit].max(initial=0.0) for limit in (1.0, 0.95)]
    average = float(np.sum(np.diff(np.insert(recall, 0, 0.0)) * precision))
    return f"| {name} | {method} | {is_right.mean():.0%} | {at[0]:.0%} | {at[1]:.0%} | {average:.2f} |"
