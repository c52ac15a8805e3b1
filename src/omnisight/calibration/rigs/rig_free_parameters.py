"""The free parameters of the calibration of a rig, besides the board poses."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.rigs.observations import RigPart
from omnisight.display import Displayed

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class RigFreeParameters(Displayed):
    """What the calibration of a rig estimates besides the board poses.

    Attributes
    ----------
    cameras
        For each camera the free directions (P, F) of its parameters.
    warps
        For each board, whether its warp is estimated.
    boards
        For each board, whether its pose relative to the first of its rigid set is estimated.
    time_offsets
        Whether the time offsets of the further cameras are estimated.
    extrinsics
        Whether the poses of the further cameras are estimated.
    """

    cameras: tuple[Array, ...]
    warps: tuple[bool, ...]
    boards: tuple[bool, ...] = ()
    time_offsets: bool = False
    extrinsics: bool = True

    def poses_only(self) -> Self:
        """Return only the extrinsics, the relations of the boards and the time offsets."""
        none = tuple(directions[:, :0] for directions in self.cameras)
        return replace(self, cameras=none, warps=(False,) * len(self.warps))

    def of_part(self, part: RigPart) -> FreeParameters:
        """Return what is estimated of the camera and the board of a part."""
        return FreeParameters(self.cameras[part.camera], self.warps[part.board])

    @cached_property
    def starts(self) -> dict[tuple[str, int], int]:
        """First column of each block of the shared parameters, by kind and index, in order."""
        sizes = {("camera", c): d.shape[1] for c, d in enumerate(self.cameras)}
        sizes |= {("warp", b): 2 for b, is_free in enumerate(self.warps) if is_free}
        sizes |= {("extrinsics", c): 6 for c in range(1, len(self.cameras)) if self.extrinsics}
        sizes |= {("board", b): 6 for b, is_free in enumerate(self.boards) if is_free}
        sizes |= {("time", c): 1 for c in range(1, len(self.cameras)) if self.time_offsets}
        ends = np.cumsum([0, *sizes.values()])
        return {**dict(zip(sizes, ends.tolist(), strict=False)), ("end", 0): int(ends[-1])}

    @property
    def count(self) -> int:
        """Number of shared parameters."""
        return self.starts["end", 0]

    def columns(self, kind: str, index: int, size: int) -> Indices:
        """Return the columns of a block of the shared parameters; none if it is not estimated."""
        start = self.starts.get((kind, index))
        return np.arange(0) if start is None else np.arange(start, start + size)

    def camera_columns(self, camera: int) -> Indices:
        """Return the columns of the parameters of a camera."""
        return self.columns("camera", camera, self.cameras[camera].shape[1])

    def extrinsic_columns(self, camera: int) -> Indices:
        """Return the columns of the pose of a camera; none for the first camera."""
        return self.columns("extrinsics", camera, 6)
