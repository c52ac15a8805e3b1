"""Inverted lists: for each word the descriptors that are assigned to it, with their images."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.places.vocabulary import Bits, Words

# Entries of a block. On average half a block of each word is empty.
BLOCK = 16


class InvertedLists:
    """For each word the descriptors that are assigned to it, in the order of their images.

    The list of a word is a chain of blocks of entries: images are added without moving others.

    Parameters
    ----------
    words
        Number of words, K.
    length
        Number of 64-bit integers of a descriptor, L.

    Attributes
    ----------
    ends
        (K, 2) first and last block of the list of each word, -1 for an empty list.
    following
        (M,) next block of the same list, -1 for the last.
    fill
        (M,) number of entries of each block.
    entry_bits, entry_image
        (M, B, L) descriptors and (M, B) images of the entries.
    """

    def __init__(self, words: int, length: int) -> None:
        self.ends = np.full((words, 2), -1)
        self.following = np.empty(0, np.int64)
        self.fill = np.empty(0, np.int64)
        self.entry_bits = np.empty((0, BLOCK, length), np.uint64)
        self.entry_image = np.empty((0, BLOCK), np.int32)
        self._used = 0

    def append(self, image: int, bits: Bits, words: Words) -> None:
        """Append descriptors (N, L) of an image to the lists of their words (N,); images come in increasing order."""
        from omnisight.places import _hamming_kernel  # imports numba, which takes a quarter of a second

        needed = self._used + len(bits)  # each descriptor needs at most one new block
        if needed > len(self.fill):
            self._reserve(max(needed, 2 * len(self.fill)))
        self._used = _hamming_kernel.append(bits, words, image, self._used, *self._arrays)

    def vote(self, bits: Bits, words: Words, similarity: NDArray[np.float64], images: int) -> NDArray[np.float64]:
        """Return the votes (images,) of descriptors (N, L) for the first images; see `_hamming_kernel.vote`."""
        from omnisight.places import _hamming_kernel

        votes = np.zeros(images)
        _hamming_kernel.vote(bits, words, similarity, votes, *self._arrays)
        return votes

    @property
    def nbytes(self) -> int:
        """Return the size of the lists in memory, bytes."""
        return sum(array.nbytes for array in self._arrays)

    @property
    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.ends, self.following, self.fill, self.entry_bits, self.entry_image

    def _reserve(self, blocks: int) -> None:
        """Make room for a number of blocks."""
        for name in ("following", "fill", "entry_bits", "entry_image"):
            old = getattr(self, name)
            new = np.empty((blocks, *old.shape[1:]), old.dtype)
            new[: len(old)] = old
            setattr(self, name, new)
