"""Train the vocabularies of places on rendered panoramas, and write them into the package.

`python -m benchmarks.train_vocabulary` takes 5 minutes. The words are descriptors drawn at random: words that are
optimized by k-majority (C. Grana et al., A fast approach for bag of words with binary descriptors, 2013) find no more
places. The benchmark of places uses scenes with other seeds.
"""

from pathlib import Path

import numpy as np

import omnisight
from benchmarks.places_scenes import keypoints_of, loop
from omnisight.features import FeatureOptions
from omnisight.places.vocabulary import Kind, Vocabulary, binary_descriptors

SCENES, IMAGES, SEED = ("room", "rooms", "street", "town"), 40, 1
WORDS = 10_000


def train(kind: Kind) -> Vocabulary:
    """Return the vocabulary of a kind of keypoints."""
    options = FeatureOptions(kind)
    images = [
        keypoints.descriptors
        for scene in SCENES
        for keypoints in keypoints_of(scene, loop(scene, IMAGES, SEED), [0.0] * IMAGES, options, SEED)
    ]
    descriptors = np.concatenate(images)
    binary = descriptors.dtype == np.uint8
    thresholds = np.zeros(0, np.float32) if binary else np.median(descriptors, axis=0).astype(np.float32)
    distinct = np.unique(binary_descriptors(descriptors, thresholds), axis=0)
    return Vocabulary.of_words(np.random.default_rng(SEED).choice(distinct, WORDS, replace=False), thresholds)


def main() -> None:
    """Train a vocabulary of each kind."""
    folder = Path(omnisight.__file__).parent / "places"
    for kind in ("sift", "orb"):
        path = folder / f"vocabulary_{kind}.npz"
        train(kind).save(str(path))
        print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
