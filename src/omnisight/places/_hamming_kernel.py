"""Compiled nearest words and inverted lists of binary descriptors, which are rows of 64-bit integers."""

# Compiled code takes its types from its arguments.
# pyright: basic

import numpy as np
from numba.extending import intrinsic

from omnisight.compiled import njit_driver, njit_inlined

# Entries of the first block of an inverted list; each further block adds half of the length of the list.
BLOCK = 16


@intrinsic
def count_ones(typing_context, bits):
    """Return the number of ones of an integer: one instruction of the processor."""
    return bits(bits), lambda context, builder, signature, values: builder.ctpop(values[0])


@njit_inlined
def hamming(a, b):
    """Return the number of different bits of two descriptors (L,)."""
    total = 0
    for i in range(len(a)):
        total += np.int64(count_ones(a[i] ^ b[i]))  # pyright: ignore[reportCallIssue]
    return total


@njit_inlined
def search(descriptor, words, start, end, distances, found):
    """Insert those of the words start ... end of (K, L) that are nearer than distances (C,), which are increasing.

    Of equally near words the first is nearest; found (C,) are their indices.
    """
    count = len(found)
    for k in range(start, end):
        distance = hamming(descriptor, words[k])
        if distance >= distances[count - 1]:
            continue
        place = count - 1
        while place > 0 and distances[place - 1] > distance:
            distances[place], found[place] = distances[place - 1], found[place - 1]
            place -= 1
        distances[place], found[place] = distance, k


@njit_driver
def nearest_words(bits, pivots, starts, words, searched, found, first, last):
    """Fill found (N, C) with the nearest words of descriptors first ... last of (N, L), the nearest first.

    Parameters
    ----------
    pivots, starts, words
        See `Vocabulary`.
    searched
        Number of cells that are searched for each descriptor: those of the nearest pivots.
    """
    beyond = 64 * words.shape[1] + 1
    cells, distances = np.empty(searched, np.int64), np.empty(found.shape[1], np.int64)
    pivot_distances = np.empty(searched, np.int64)
    for n in range(first, last):
        pivot_distances[:], distances[:], found[n] = beyond, beyond, 0
        search(bits[n], pivots, 0, len(pivots), pivot_distances, cells)
        for cell in cells:
            search(bits[n], words, starts[cell], starts[cell + 1], distances, found[n])


@njit_driver
def append(bits, words, image, done, used, lists, blocks, entry_bits, entry_image):
    """Append descriptors done ... N of (N, L) of an image to the lists of their words (N,).

    Parameters
    ----------
    used, lists, blocks, entry_bits, entry_image
        See `InvertedLists`.

    Returns
    -------
    Number of descriptors that are appended: fewer than N if there is no room for another block.
    """
    for n in range(done, len(bits)):
        word = words[n]
        last = lists[word, 1]
        if last < 0 or blocks[last, 2] == blocks[last, 1]:
            capacity = max(BLOCK, lists[word, 2] // 2)
            if used[0] == len(blocks) or used[1] + capacity > len(entry_image):
                return n
            new = used[0]
            blocks[new, 0], blocks[new, 1], blocks[new, 2], blocks[new, 3] = used[1], capacity, 0, -1
            if last < 0:
                lists[word, 0] = new
            else:
                blocks[last, 3] = new
            lists[word, 1] = last = new
            used[0] += 1
            used[1] += capacity
        entry = blocks[last, 0] + blocks[last, 2]
        entry_image[entry] = image
        for k in range(bits.shape[1]):
            entry_bits[entry, k] = bits[n, k]
        blocks[last, 2] += 1
        lists[word, 2] += 1
    return len(bits)


@njit_driver
def vote(bits, words, similarity, votes, lists, blocks, entry_bits, entry_image):
    """Add the votes of descriptors (N, L) to votes (I,) of the first images.

    Each descriptor has one vote, which it shares between its own image and those with similar descriptors, in
    proportion to the similarity of the nearest descriptor of each.

    Parameters
    ----------
    words
        (N, C) words whose lists are searched for each descriptor.
    similarity
        (D,) of descriptors with 0 ... D - 1 different bits; more are not similar.
    lists, blocks, entry_bits, entry_image
        See `InvertedLists`.
    """
    limit = len(similarity)
    nearest = np.full(len(votes), limit, np.int64)
    similar = np.empty(len(votes), np.int64)
    for n in range(len(bits)):
        count = 0
        for word in words[n]:
            block = lists[word, 0]
            while block >= 0:
                first, filled = blocks[block, 0], blocks[block, 2]
                for entry in range(first, first + filled):
                    distance = hamming(bits[n], entry_bits[entry])
                    if distance >= limit or entry_image[entry] >= len(votes):
                        continue
                    image = entry_image[entry]
                    if nearest[image] == limit:
                        similar[count] = image
                        count += 1
                    nearest[image] = min(nearest[image], distance)
                block = blocks[block, 3]
        total = 1.0
        for image in similar[:count]:
            total += similarity[nearest[image]]
        for image in similar[:count]:
            votes[image] += similarity[nearest[image]] / total
            nearest[image] = limit
