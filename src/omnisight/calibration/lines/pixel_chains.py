"""Chains of pixels along the images of lines, stored in flat arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.calibration.lines.line_conics import fit_circle
from omnisight.display import Displayed

Array = NDArray[np.float64]

# The plane of a line has two parameters; a third pixel is the first to constrain the camera.
MIN_CHAIN_PIXELS = 3


@dataclass(frozen=True)
class PixelChains(Displayed):
    """Pixels along the images of lines, concatenated.

    Attributes
    ----------
    pixels
        (N, 2) pixels, ordered along each chain.
    groups
        Rows of `pixels` of each chain, as one slice per chain.
    image_ids
        (L,) index of the image that each chain comes from.
    """

    pixels: Array
    groups: tuple[slice, ...]
    image_ids: NDArray[np.intp]

    @classmethod
    def from_arrays(
        cls, chains: Sequence[ArrayLike], image_ids: Sequence[int] | NDArray[np.intp] | None = None
    ) -> Self:
        """Concatenate chains of pixels (n, 2).

        Parameters
        ----------
        chains
            One (n, 2) array per chain, n >= 3.
        image_ids
            Image index of each chain; by default all chains come from one image.

        Raises
        ------
        ValueError
            If a chain has another shape, fewer than three pixels or a value that is not finite, or if the number of
            image indices differs from the number of chains.
        """
        parts = [np.zeros((0, 2)), *(_checked_chain(chain, i + 1) for i, chain in enumerate(chains))]
        stops = np.cumsum([len(part) for part in parts]).tolist()
        groups = tuple(slice(start, stop) for start, stop in pairwise(stops))
        ids = np.zeros(len(groups), np.intp) if image_ids is None else np.asarray(image_ids, np.intp)
        if len(ids) != len(groups):
            raise ValueError(f"{len(groups)} lines, but image indices of {len(ids)} lines")
        return cls(np.concatenate(parts), groups, ids)

    def __len__(self) -> int:
        """Return the number of chains."""
        return len(self.groups)

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """(L,) first row of each chain."""
        return np.array([g.start for g in self.groups], np.intp)

    @cached_property
    def counts(self) -> NDArray[np.intp]:
        """(L,) number of pixels of each chain."""
        return np.array([g.stop - g.start for g in self.groups], np.intp)

    @cached_property
    def chain_of_pixel(self) -> NDArray[np.intp]:
        """(N,) chain index of each pixel."""
        return np.repeat(np.arange(len(self)), self.counts)

    @cached_property
    def arc_lengths(self) -> Array:
        """(L,) length of each chain, px."""
        steps = np.linalg.norm(np.diff(self.pixels, axis=0, append=np.nan), axis=1)
        return np.array([steps[g.start : g.stop - 1].sum() for g in self.groups])

    @cached_property
    def circle_rms(self) -> Array:
        """(L,) root mean square distance (px) of each chain from its circle."""
        return np.array([np.sqrt((fit_circle(chain).distance(chain) ** 2).mean()) for chain in self.split()])

    def longest_first(self) -> NDArray[np.intp]:
        """Return the chain indices (L,) in order of decreasing arc length."""
        return np.argsort(-self.arc_lengths, kind="stable")

    def split(self) -> list[Array]:
        """Return the pixels (n, 2) of each chain."""
        return [self.pixels[g] for g in self.groups]

    def subset(self, indices: Sequence[int] | NDArray[np.intp]) -> Self:
        """Return the chains with the given indices."""
        return self.from_arrays(
            [self.pixels[self.groups[i]] for i in indices], self.image_ids[np.asarray(indices, np.intp)]
        )

    def subsample(self, max_pixels: int) -> Self:
        """Return at most `max_pixels` pixels of each chain, evenly spaced, including both ends."""
        kept = [
            part[np.unique(np.linspace(0, len(part) - 1, max_pixels).round().astype(np.intp))]
            if len(part) > max_pixels
            else part
            for part in self.split()
        ]
        return self.from_arrays(kept, self.image_ids)

    def sum_by_chain(self, values: Array) -> Array:
        """Sum values (N, ...) over the pixels of each chain; return (L, ...)."""
        return np.add.reduceat(values, self.starts, axis=0) if len(self) else values[:0]

    def rms_by_chain(self, distances: Array) -> Array:
        """Return the root mean square (L,) of distances (N,) over the pixels of each chain."""
        return np.sqrt(self.sum_by_chain(distances**2) / np.maximum(self.counts, 1))


def _checked_chain(chain: ArrayLike, number: int) -> Array:
    """Return one chain as an array (n, 2), or raise `ValueError`."""
    pixels = np.asarray(chain, float)
    if pixels.ndim != 2 or pixels.shape[1] != 2:
        raise ValueError(f"line {number}: expected pixels of shape (n, 2), got {pixels.shape}")
    if len(pixels) < MIN_CHAIN_PIXELS:
        raise ValueError(f"line {number}: has {len(pixels)} pixels, at least {MIN_CHAIN_PIXELS} are needed")
    if not np.isfinite(pixels).all():
        raise ValueError(f"line {number}: has a pixel that is not finite")
    return pixels
