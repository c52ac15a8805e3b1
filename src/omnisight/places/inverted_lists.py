"""Inverted lists: for each word the descriptors that are assigned to it, with their images."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.places.vocabulary import Bits, Words


class InvertedLists:
    """For each word the descriptors that are assigned to it, in the order of their images.

    The list of a word is a chain of blocks of entries, so that images are added without moving others. The blocks grow
    with the list: long lists are read in few pieces of contiguous memory.

    Parameters
    ----------
    words
        Number of words, K.
    length
        Number of 64-bit integers of a descriptor, L.

    Attributes
    ----------
    lists
        (K, 3) first and last block of the list of each word, -1 for an empty list, and its number of entries.
    blocks
        (M, 4) first entry, capacity and number of entries of each block, and next block of the same list, -1 for the
        last.
    entry_bits, entry_image
        (E, L) descriptors and (E,) images of the entries.
    used
        Numbers of blocks and of entries in use; of entries those that blocks have reserved.
    """

    def __init__(self, words: int, length: int) -> None:
        self.lists = np.tile([-1, -1, 0], (words, 1))
        self.blocks = np.empty((0, 4), np.int64)
        self.entry_bits = np.empty((0, length), np.uint64)
        self.entry_image = np.empty(0, np.int32)
        self.used = np.zeros(2, np.int64)

    def append(self, image: int, bits: Bits, words: Words) -> None:
        """Append descriptors (N, L) of an image to the lists of their words (N,); images come in increasing order."""
        from omnisight.places import _hamming_kernel  # imports numba, which takes a quarter of a second

        done = 0
        while (done := _hamming_kernel.append(bits, words, image, done, self.used, *self._arrays)) < len(bits):
            self._grow(len(bits), _hamming_kernel.BLOCK * len(bits))

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
        return self.lists, self.blocks, self.entry_bits, self.entry_image

    def _grow(self, blocks: int, entries: int) -> None:
        """Double the numbers of blocks and of entries, or add as many as are passed if that is more."""
        self.blocks = _extended(self.blocks, max(blocks, len(self.blocks)))
        more = max(entries, len(self.entry_image))
        self.entry_bits, self.entry_image = (_extended(x, more) for x in (self.entry_bits, self.entry_image))


def _extended(array: NDArray[Any], more: int) -> NDArray[Any]:
    """Return an array with more rows, whose values are any."""
    longer = np.empty((len(array) + more, *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer
