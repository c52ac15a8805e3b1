"""Images of lines as chains of pixels, in flat arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

FEWEST_PIXELS = 3


@dataclass(frozen=True)
class Chains:
    """Pixels along the images of lines, all of them in one array.

    Attributes
    ----------
    pixels
        (N, 2), those of a chain ordered along it.
    groups
        One slice of the rows per chain.
    pictures
        (L,) the picture that each chain is in.
    """

    pixels: Array
    groups: tuple[slice, ...]
    pictures: NDArray[np.intp]

    @classmethod
    def of(cls, chains: Sequence[ArrayLike], pictures: Sequence[int] | NDArray[np.intp] | None = None) -> Self:
        """Join chains of pixels (n, 2), of one picture unless told otherwise.

        Raises
        ------
        ValueError
            If one has another shape, fewer than three pixels, or a number that is not finite.
        """
        parts, groups, start = [np.zeros((0, 2))], list[slice](), 0
        for i, chain in enumerate(chains):
            part = np.asarray(chain, float)
            if part.ndim != 2 or part.shape[1] != 2:
                raise ValueError(f"line {i + 1}: needs pixels of shape (n, 2), got {part.shape}")
            if len(part) < FEWEST_PIXELS:
                raise ValueError(f"line {i + 1}: has {len(part)} pixels; {FEWEST_PIXELS} is the least")
            if not np.isfinite(part).all():
                raise ValueError(f"line {i + 1}: a pixel is not a finite number")
            parts.append(part)
            groups.append(slice(start, start + len(part)))
            start += len(part)
        shown = np.zeros(len(groups), np.intp) if pictures is None else np.asarray(pictures, np.intp)
        if len(shown) != len(groups):
            raise ValueError(f"{len(groups)} lines, but the pictures of {len(shown)}")
        return cls(np.concatenate(parts), tuple(groups), shown)

    def __len__(self) -> int:
        """Give the number of chains."""
        return len(self.groups)

    @property
    def starts(self) -> NDArray[np.intp]:
        """(L,) the first row of each chain."""
        return np.array([g.start for g in self.groups], np.intp)

    @property
    def counts(self) -> NDArray[np.intp]:
        """(L,) how many pixels each chain has."""
        return np.array([g.stop - g.start for g in self.groups], np.intp)

    @property
    def chain_of_row(self) -> NDArray[np.intp]:
        """(N,) the chain of each pixel."""
        return np.repeat(np.arange(len(self)), self.counts)

    @property
    def spans(self) -> Array:
        """(L,) px from a chain's first pixel to its last, along it."""
        steps = np.linalg.norm(np.diff(self.pixels, axis=0, append=np.nan), axis=1)
        return np.array([steps[g.start : g.stop - 1].sum() for g in self.groups])

    def each(self) -> list[Array]:
        """Give the pixels (n, 2) chain by chain."""
        return [self.pixels[g] for g in self.groups]

    def subset(self, chosen: Sequence[int] | NDArray[np.intp]) -> Self:
        """Give some of the chains."""
        return self.of([self.pixels[self.groups[i]] for i in chosen], self.pictures[np.asarray(chosen, np.intp)])

    def thinned(self, most: int) -> Self:
        """Give at most so many pixels of each chain, evenly along it, its ends among them."""
        kept = [
            part[np.unique(np.linspace(0, len(part) - 1, most).round().astype(np.intp))] if len(part) > most else part
            for part in self.each()
        ]
        return self.of(kept, self.pictures)

    def sums(self, values: Array) -> Array:
        """Sum values (N, ...) over each chain (L, ...)."""
        return np.add.reduceat(values, self.starts, axis=0) if len(self) else values[:0]
