"""A lattice with what was measured at its corners."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.detectors.checkerboard.lattice import Lattice, bends, steps
from omnisight.targets.subpixel.corner_fit import fit_corners

Array = NDArray[np.float64]


@dataclass
class MeasuredLattice:
    """Fits at the corners of a lattice; NaN where a corner is missing.

    Attributes
    ----------
    pixels : (R, C, 2) array
    covariance : (R, C, 2, 2) array
    amplitude, blur, explained : (R, C) array
        As in `PointFits`.
    """

    pixels: Lattice
    covariance: Array
    amplitude: Array
    blur: Array
    explained: Array

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> "MeasuredLattice":
        """Return a lattice of a shape without any corners."""
        return cls(*(np.full((*shape[:2], *more), np.nan) for more in ((2,), (2, 2), (), (), ())))

    @property
    def present(self) -> NDArray[np.bool_]:
        """Which corners (R, C) are not missing."""
        return np.isfinite(self.pixels[..., 0])

    def measure(
        self, gray: NDArray[np.uint8], lattice: Lattice, where: NDArray[np.bool_], *, rough: bool = False
    ) -> None:
        """Measure the corners (R, C) in `where` from their pixels, steps and bends in `lattice`."""
        i, j = np.nonzero(where & np.isfinite(lattice[..., 0]))
        local_steps = np.stack(steps(lattice), axis=-2)[i, j]
        local_bends = np.nan_to_num(np.stack(bends(lattice), axis=-2)[i, j])
        fits = fit_corners(gray, lattice[i, j], local_steps, local_bends, rough=rough)
        for own, values in zip(self._arrays(), fits, strict=True):
            own[i, j] = values

    def padded(self) -> "MeasuredLattice":
        """Return a copy with one more line of missing corners on each side."""
        wide = MeasuredLattice.empty((self.pixels.shape[0] + 2, self.pixels.shape[1] + 2))
        for own, other in zip(wide._arrays(), self._arrays(), strict=True):
            own[1:-1, 1:-1] = other
        return wide

    def part(self, rows: slice, columns: slice) -> "MeasuredLattice":
        """Return some of the rows and columns."""
        return MeasuredLattice(*(array[rows, columns] for array in self._arrays()))

    def mirrored(self) -> "MeasuredLattice":
        """Return a copy with the columns reversed, which changes the sign of the amplitude."""
        other = self.part(slice(None), slice(None, None, -1))
        other.amplitude = -other.amplitude
        return other

    def drop(self, where: NDArray[np.bool_]) -> None:
        """Remove corners (R, C)."""
        for array in self._arrays():
            array[where] = np.nan

    def _arrays(self) -> tuple[Array, ...]:
        return self.pixels, self.covariance, self.amplitude, self.blur, self.explained
