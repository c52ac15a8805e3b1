"""Remap tables: the source pixel of every pixel of a view."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.views.cube import cube_cross
from omnisight.views.maps import coverage_mask, is_periodic, map_scale, view_map
from omnisight.views.remapper import SCALE_STEP_PX, Interpolation

Array = NDArray[np.float64]
Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RemapTable(Displayed):
    """The source pixel of every pixel of a view.

    Attributes
    ----------
    source, target
        The camera of the images and the camera of the view (of one face of a cube).
    rotations
        target_from_source (3, 3) of the view, or of each face of a cube.
    u, v
        (H, W) source pixel, where the centre of the top-left pixel is (0, 0).
    covered
        (H, W) whether the source covers the pixel of the view; `u` and `v` hold only there.
    interpolation
        Interpolation between source pixels that is asked for.
    """

    source: Camera
    target: Camera
    rotations: tuple[Array, ...]
    u: Floats
    v: Floats
    covered: NDArray[np.bool_]
    interpolation: Interpolation = "bicubic"

    @classmethod
    def of(
        cls, source: Camera, target: Camera, rotations: Sequence[Array], interpolation: Interpolation = "bicubic"
    ) -> Self:
        """Compute the table of a view of one rotation, or of a cross of six faces of a cube.

        Raises
        ------
        ValueError
            If the size of the source images is unknown, or they do not cover any pixel of the view.
        """
        if not all(source.size):
            raise ValueError("the camera file has no image size: specify it, such as --image-size 1920x1080")
        maps = [view_map(source, target, rotation) for rotation in rotations]
        u, v = (cube_cross([pair[k] for pair in maps]) for k in range(2))
        covered = cube_cross([coverage_mask(source, *pair) for pair in maps])
        if not covered.any():
            raise ValueError("the images of this camera do not show any pixel of the view: change its direction")
        if is_periodic(source):
            u = np.where(covered, (u + 0.5) % source.width - 0.5, u)
        return cls(source, target, tuple(rotations), u, v, covered, interpolation)

    @property
    def is_periodic(self) -> bool:
        """Whether the left and the right edge of the source adjoin (360 degrees)."""
        return is_periodic(self.source)

    @cached_property
    def scale(self) -> float:
        """Largest number of source pixels that a pixel of the view spans."""
        scale = map_scale(self.source, self.u, self.v, SCALE_STEP_PX)
        here = self.covered[::SCALE_STEP_PX, ::SCALE_STEP_PX] & np.isfinite(scale)
        return float(np.quantile(scale[here], 0.99)) if here.any() else 1.0

    def filled(self, values: NDArray[np.generic], fill: float) -> Floats:
        """Return values (H, W) as float32 with another value where the source does not cover the view."""
        return np.where(self.covered, values, fill).astype(np.float32)


def with_suffix(output: Path, suffixes: Sequence[str]) -> Path:
    """Return an output file with the first of the suffixes that a format has, unless it has one of them.

    Raises
    ------
    ValueError
        If it has another suffix.
    """
    name = output.name.lower()
    if any(name.endswith(suffix) for suffix in suffixes):
        return output
    if output.suffix:
        raise ValueError(f"{output}: this format is written as {' or '.join(suffixes)}; change the name of the file")
    return output.with_name(output.name + suffixes[0])
