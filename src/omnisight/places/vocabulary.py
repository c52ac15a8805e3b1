"""Visual words: a descriptor is assigned to the nearest of a set of binary descriptors."""

from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from io import BytesIO
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.features import Keypoints
from omnisight.parallel import parallel_for

Bits = NDArray[np.uint64]
Words = NDArray[np.int64]
Kind = Literal["sift", "orb"]

# Words that divide the others into cells, and cells that are searched for a descriptor. They contain the nearest word
# of 89 % of the descriptors; overlapping images are found as well as by comparison with all words, at a quarter of the
# time.
PIVOTS, SEARCHED_CELLS = 100, 10
# Descriptors for which another thread is worth its start.
GRAIN = 256


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """Binary descriptors of a training set, which divide the space of descriptors into cells.

    Attributes
    ----------
    words
        (K, L) descriptors of 64 L bits, sorted by their nearest pivots.
    pivots
        (P, L) some of the words.
    starts
        (P + 1,) first word of the cell of each pivot, and K.
    thresholds
        (64 L,) medians of the elements of descriptors of float32, which turn them into bits; empty for binary ones.
    """

    words: Bits
    pivots: Bits
    starts: Words
    thresholds: NDArray[np.float32]

    @classmethod
    def of_words(cls, words: Bits, thresholds: NDArray[np.float32]) -> Self:
        """Return the vocabulary of words (K, L) in random order."""
        pivots = words[:PIVOTS]
        cell = _nearest(words, pivots[:1], np.array((0, len(pivots))), pivots, 1, 1)[:, 0]
        order = np.argsort(cell, kind="stable")
        return cls(words[order], pivots, np.searchsorted(cell[order], np.arange(len(pivots) + 1)), thresholds)

    def bits(self, keypoints: Keypoints) -> Bits:
        """Return the descriptors as bits (N, L).

        Raises
        ------
        ValueError
            If the descriptors are of another kind.
        """
        descriptors, length = keypoints.descriptors, self.words.shape[1]
        expected = ("float32", 64 * length) if len(self.thresholds) else ("uint8", 8 * length)
        if (descriptors.dtype.name, descriptors.shape[1]) != expected:
            raise ValueError(
                f"the vocabulary has descriptors {expected[0]} x {expected[1]}, but the image has {keypoints!r}: detect"
                " keypoints of the kind of the vocabulary, sift or orb"
            )
        return binary_descriptors(descriptors, self.thresholds)

    def nearest(self, bits: Bits, count: int) -> Words:
        """Return the indices (N, count) of words with few different bits, the fewest first."""
        return _nearest(bits, self.pivots, self.starts, self.words, SEARCHED_CELLS, count)

    def save(self, path: str) -> None:
        """Write an npz file."""
        np.savez(path, **{field.name: getattr(self, field.name) for field in fields(self)})


@cache
def load_vocabulary(kind: Kind) -> Vocabulary:
    """Return the vocabulary of a kind of keypoints, which is part of the package.

    Raises
    ------
    ValueError
        If there is none.
    """
    file = files(__package__ or "") / f"vocabulary_{kind}.npz"
    if not file.is_file():
        raise ValueError(f"there is no vocabulary of {kind!r} keypoints: use sift or orb")
    with np.load(BytesIO(file.read_bytes()), allow_pickle=False) as arrays:
        return Vocabulary(**{field.name: arrays[field.name] for field in fields(Vocabulary)})


def binary_descriptors(descriptors: NDArray[Any], thresholds: NDArray[np.float32]) -> Bits:
    """Return descriptors (N, D), uint8 with 8 bits each or floats to compare with thresholds (D,), as bits (N, L)."""
    packed = descriptors if descriptors.dtype == np.uint8 else np.packbits(descriptors > thresholds, axis=1)
    return np.ascontiguousarray(packed).view(np.uint64)


def _nearest(bits: Bits, pivots: Bits, starts: Words, words: Bits, searched: int, count: int) -> Words:
    """Return the indices (N, count) of the nearest words to descriptors (N, L); see `_hamming_kernel.nearest_words`."""
    from omnisight.places import _hamming_kernel  # imports numba, which takes a quarter of a second

    found, length = np.empty((len(bits), count), np.int64), len(bits)
    arguments = bits, pivots, starts, words, searched, found
    parallel_for(lambda first, last: _hamming_kernel.nearest_words(*arguments, first, last), length, GRAIN)
    return found
