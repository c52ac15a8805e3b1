"""Retrieval of images on rendered panoramas with known overlap, and on a robot's route.

`python -m benchmarks places` prints the tables of docs/guide/places.md. The rendered images are kept in the cache
folder, or in the folder of temporary files if it does not exist. The variable OMNISIGHT_DATA names the folder of the
real images, without which the robot's route is left out.
"""

import argparse
import dataclasses
import os
import sys
import time
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from benchmarks.places_scenes import both_lanes, keypoints_of, loop, overlaps
from benchmarks.places_visits import print_visits
from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.images import to_gray8
from omnisight.places.place_index import MAX_KEYPOINTS
from omnisight.places.vocabulary import Kind
from omnisight.progress import no_progress
from omnisight.sfm.view_graph import overlapping_pairs
from omnisight.simulation import scene_named

Array = NDArray[np.float64]
Pairs = list[tuple[int, int]]

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parent.parent.parent / "shared/data"))
# Scenes, their number of images, and whether both lanes are driven.
SETS = (("town", 200, True), ("street", 60, True), ("rooms", 60, False))
# Share of the surface seen from both images of an overlapping pair.
OVERLAP = 0.2
KINDS: tuple[Kind, ...] = ("sift", "orb")
# Images of the large index, and standard deviation by which their descriptors differ.
TIMED_IMAGES, DESCRIPTOR_NOISE = 1000, 0.03
# Panoramas of the route are magnified for SIFT; one of so many is a reference.
ROUTE_SCALE, REFERENCE_STEP = 8, 20


def select_pairs(name: str, keypoints: Sequence[Keypoints], overlap: Array) -> None:
    """Print how many of the overlapping pairs each selection finds."""
    true = np.triu(overlap, 1) > OVERLAP
    every = list(combinations(range(len(keypoints)), 2))
    methods: dict[str, Callable[[], Pairs]] = {
        "`similar_pairs`, 10 neighbours": lambda: om.similar_pairs(keypoints, 10),
        "`similar_pairs`, 20 neighbours": lambda: om.similar_pairs(keypoints, 20),
        "matches of the 300 strongest": lambda: overlapping_pairs(keypoints, every, no_progress),
    }
    for method, select in methods.items():
        start = time.perf_counter()
        a, b = np.array(select()).T
        seconds = time.perf_counter() - start
        recall = true[a, b].sum() / true.sum()
        print(f"| {name} | {method} | {len(a)} of {len(every)} | {100 * recall:.1f} % | {seconds:.1f} s |", flush=True)


def find_places(keypoints: Sequence[Keypoints], overlap: Array, kind: Kind) -> tuple[float, float]:
    """Query the first half of the images by each of the second; return how often the best, one of five overlaps."""
    half, index = len(keypoints) // 2, om.PlaceIndex(kind)
    for each in keypoints[:half]:
        index.add(each)
    ranked = [[place.image for place in index.query(each, 5)] for each in keypoints[half:]]
    found = [overlap[half + i, images] > OVERLAP for i, images in enumerate(ranked)]
    return float(np.mean([each[0] for each in found])), float(np.mean([any(each) for each in found]))


def rendered(quick: bool) -> list[Keypoints]:
    """Print the tables of the rendered sets; return the keypoints of SIFT of all."""
    print("| images | selection | pairs | overlapping pairs found | time |\n|---|---|---|---|---|")
    lines: list[str] = []
    every: list[Keypoints] = []
    for scene, count, is_both in (("street", 30, True),) if quick else SETS:
        poses, exposures = both_lanes(scene, count) if is_both else (loop(scene, count), [0.0] * count)
        overlap = overlaps(scene_named(scene), poses)
        for kind in KINDS:
            keypoints = keypoints_of(scene, poses, exposures, FeatureOptions(kind))
            if kind == "sift":
                om.similar_pairs(keypoints[:3])  # compile
                every += keypoints
                select_pairs(f"{scene}, {count}", keypoints, overlap)
            if is_both:
                first, five = find_places(keypoints, overlap, kind)
                lines.append(f"| {scene}, {count // 2} in {count // 2} | {kind} | {first:.0%} | {five:.0%} |")
    print("\n| images of the other lane | keypoints | first overlaps | one of five |\n|---|---|---|---|")
    print("\n".join(lines), flush=True)
    return every


def route() -> None:
    """Print how often images between the references of a robot's route find one of the two references beside them.

    The image difference is the largest correlation of two panoramas over all rotations (J. Zeil et al., 2003).
    """
    folder = DATA / "robot_route"
    if not folder.is_dir():
        return
    rows = [line.split(",") for line in (folder / "snapshots.csv").read_text().splitlines()[1:]]
    images = [to_gray8(om.read_image(folder / row[1].strip())) for row in rows]
    keypoints, fourier, index = route_keypoints(images), spectra(images), om.PlaceIndex()
    references = range(0, len(images), REFERENCE_STEP)
    for i in references:
        index.add(keypoints[i])
    beside: list[tuple[bool, bool]] = []
    for i in sorted(set(range(references[-1])) - set(references)):
        products = np.einsum("nrf,rf->nf", fourier[references].conj(), fourier[i])
        nearest = int(np.fft.irfft(products).max(axis=1).argmax()), index.query(keypoints[i], 1)[0].image
        beside.append(tuple(abs(references[each] - i) < REFERENCE_STEP for each in nearest))
    difference, places = np.mean(beside, axis=0)
    print(f"\nroute: {len(beside)} images between {len(references)} references, one of the two beside them is first:")
    print(f"places {places:.0%}, image difference {difference:.0%}")


def route_keypoints(images: Sequence[NDArray[np.uint8]]) -> list[Keypoints]:
    """Return keypoints of magnified panoramas."""
    height, width = images[0].shape
    camera = om.sphere(width * ROUTE_SCALE, elevation=(-180 * height / width, 180 * height / width))
    import cv2

    larger = [cv2.resize(image, camera.size, interpolation=cv2.INTER_CUBIC) for image in images]
    return [detect_features(np.asarray(image), camera, FeatureOptions(surface="image")) for image in larger]


def spectra(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.complex128]:
    """Return the Fourier transforms (N, H, F) of the rows of normalized images."""
    stack = np.array(images, float)
    stack -= stack.mean((1, 2), keepdims=True)
    return np.fft.rfft(stack / stack.std((1, 2), keepdims=True))


def times_of_large_index(keypoints: Sequence[Keypoints]) -> None:
    """Print time and memory of a large index of images whose descriptors are those of others with noise."""
    rng = np.random.default_rng(0)
    pool = np.concatenate([each.descriptors for each in keypoints])
    empty = keypoints[0][np.zeros(MAX_KEYPOINTS, int)]
    images: list[Keypoints] = []
    for _ in range(TIMED_IMAGES):
        drawn = pool[rng.integers(len(pool), size=MAX_KEYPOINTS)]
        noise = DESCRIPTOR_NOISE * rng.standard_normal(drawn.shape, np.float32)
        images.append(dataclasses.replace(empty, descriptors=drawn + noise))
    index, start = om.PlaceIndex(), time.perf_counter()
    for image in images:
        index.add(image)
    added = time.perf_counter()
    for image in images[:50]:
        index.query(image)
    queried = time.perf_counter()
    print(
        f"\n{TIMED_IMAGES} images of {MAX_KEYPOINTS} keypoints, the most that are used: added in {added - start:.0f} s,"
        f" queried in {1000 * (queried - added) / 50:.0f} ms each, {index.nbytes / 1e6:.0f} MB"
    )


def main(arguments: Sequence[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks places", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="30 images of the street only")
    parser.add_argument("--visits", action="store_true", help="only places of the town at another visit")
    options = parser.parse_args(arguments)
    quick = options.quick
    if options.visits:
        print_visits()
        return
    keypoints = rendered(quick)
    if not quick:
        times_of_large_index(keypoints)
        route()
        print_visits()


if __name__ == "__main__":
    main(sys.argv[1:])
