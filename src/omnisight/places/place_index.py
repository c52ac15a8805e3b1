"""Image retrieval: which images show the place of another image."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omnisight.display import named_tuple_text
from omnisight.features import Keypoints
from omnisight.parallel import parallel_map
from omnisight.places.inverted_lists import InvertedLists
from omnisight.places.vocabulary import Bits, Kind, Words, load_vocabulary
from omnisight.progress import StageProgress, no_progress

# Keypoints of an image that are used, the strongest.
MAX_KEYPOINTS = 2000
# Words whose lists are searched for a descriptor: the nearest word of another image of the same point is among them.
SEARCHED_WORDS = 4
# Largest share of different bits of similar descriptors, and the share at which the similarity is 1/e: 90 % of the
# correct matches of SIFT between neighbouring rendered images are within 0.21.
MAX_BIT_SHARE, SIMILARITY_BIT_SHARE = 0.22, 0.23


class Place(NamedTuple):
    """An image that is similar to a query.

    Attributes
    ----------
    image
        Its number, in the order of `PlaceIndex.add`.
    score
        From 0 to 1: the votes that it gets from the descriptors of the query, over the geometric mean of the numbers of
        descriptors of both.
    """

    image: int
    score: float

    __repr__ = named_tuple_text


class ImageWords(NamedTuple):
    """The descriptors (N, L) of an image and the indices (N, C) of their nearest words, the nearest first."""

    bits: Bits
    words: Words


class PlaceIndex:
    """An index of images by their keypoints, which finds images of the same place.

    Each descriptor of a query has one vote, which it shares among the images with a similar descriptor (H. Jegou et
    al., Hamming embedding, ECCV 2008, with the inverse document frequency of each descriptor in place of that of its
    word). Descriptors that many images show, such as those of a repeated window, contribute little. Bearings are not
    used, so the score is independent of the orientation of the camera. Similar descriptors are found by the
    inverted lists of binary words (D. Galvez-Lopez and J. Tardos, Bags of binary words, T-RO 2012).

    Parameters
    ----------
    kind
        Kind of the keypoints, as in `FeatureOptions`: "sift" or "orb".

    Examples
    --------
    >>> index = PlaceIndex()
    >>> for keypoints in images:
    ...     index.add(keypoints)
    >>> index.query(images[0], 3)
    """

    def __init__(self, kind: Kind = "sift") -> None:
        self._vocabulary = load_vocabulary(kind)
        self._lists = InvertedLists(*self._vocabulary.words.shape)
        self._counts: list[int] = []
        distances = np.arange(int(MAX_BIT_SHARE * 64 * self._vocabulary.words.shape[1]) + 1)
        self._similarity = np.exp(-((distances / (SIMILARITY_BIT_SHARE * 64 * self._vocabulary.words.shape[1])) ** 2))

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self._counts)

    def __repr__(self) -> str:
        """Return the numbers of images and descriptors."""
        return f"PlaceIndex({len(self)} images, {sum(self._counts)} descriptors)"

    @property
    def nbytes(self) -> int:
        """Return the size of the index in memory, bytes."""
        return self._lists.nbytes

    def add(self, keypoints: Keypoints) -> int:
        """Add an image; return its number.

        Raises
        ------
        ValueError
            If its descriptors are of another kind than those of the index.
        """
        return self.add_words(self.words(keypoints))

    def query(self, keypoints: Keypoints, count: int = 10, *, before: int | None = None) -> list[Place]:
        """Return the most similar images, the most similar first.

        Parameters
        ----------
        keypoints
            Of an image, which need not be in the index.
        count
            Largest number of images; images without a similar descriptor are left out.
        before
            Compare with the images of smaller numbers only, for example those of a video more than some seconds ago.

        Raises
        ------
        ValueError
            If the descriptors are of another kind than those of the index.
        """
        return self.query_words(self.words(keypoints), count, before=before)

    def words(self, keypoints: Keypoints) -> ImageWords:
        """Return the strongest descriptors with their nearest words."""
        bits = self._vocabulary.bits(keypoints[:MAX_KEYPOINTS])
        return ImageWords(bits, self._vocabulary.nearest(bits, SEARCHED_WORDS))

    def add_words(self, image: ImageWords) -> int:
        """Add an image with known words; return its number."""
        number = len(self)
        self._lists.append(number, image.bits, image.words[:, 0])
        self._counts.append(len(image.bits))
        return number

    def query_words(self, image: ImageWords, count: int, *, before: int | None = None) -> list[Place]:
        """Return the most similar images to an image with known words; see `query`."""
        candidates = len(self) if before is None else min(max(before, 0), len(self))
        votes = self._lists.vote(*image, self._similarity, candidates)
        score = votes / np.sqrt(np.maximum(np.array(self._counts[:candidates], float) * len(image.bits), 1))
        best = np.argsort(-score, kind="stable")[:count]
        return [Place(int(i), float(score[i])) for i in best if score[i] > 0]


def similar_pairs(
    keypoints: Sequence[Keypoints],
    neighbours: int = 20,
    progress: StageProgress = no_progress,
    kind: Kind = "sift",
) -> list[tuple[int, int]]:
    """Return the pairs of images that are likely to overlap: each image with its most similar ones.

    Parameters
    ----------
    keypoints
        Of each image.
    neighbours
        Number of most similar images of each; an image can be in more pairs, as a neighbour of others.
    progress
        Called with the number of steps done and of all; each image takes two.
    kind
        Kind of the keypoints.

    Returns
    -------
    Pairs (a, b) with a < b, sorted.

    Raises
    ------
    ValueError
        If the descriptors are of another kind.
    """
    index, count = PlaceIndex(kind), len(keypoints)
    images: list[ImageWords] = []
    for each in keypoints:
        images.append(index.words(each))
        index.add_words(images[-1])
        progress(len(images), 2 * count)
    ranked = parallel_map(
        lambda image: index.query_words(image, neighbours + 1),
        images,
        lambda done, _: progress(count + done, 2 * count),
    )
    pairs = {(min(a, b), max(a, b)) for a, found in enumerate(ranked) for b, _ in found if a != b}
    return sorted(pairs)
