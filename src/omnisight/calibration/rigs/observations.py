"""Boards that the cameras of a rig observed, and which of the images are simultaneous."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RigPart:
    """All views of one board by one camera.

    Attributes
    ----------
    camera, board
        Indices of the camera and of the board.
    observations
        The views; each is one board in one image.
    group
        (V,) index of the board pose that each view observes: views of the same group share it.
    delays
        (V,) known time (s) of each view after that of its group.
    """

    camera: int
    board: int
    observations: Observations
    group: Indices
    delays: Array

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.group)

    def subset(self, views: Indices) -> Self:
        """Return some of the views."""
        return replace(
            self,
            observations=self.observations.subset(views),
            group=self.group[views],
            delays=self.delays[views],
        )


@dataclass(frozen=True, eq=False)
class RigObservations:
    """Boards that the cameras of a rig observed.

    Attributes
    ----------
    names
        Name of each camera.
    parts
        The views, by camera and board; several parts can have the same camera.
    groups
        Name of each group: of the images that were taken at the same time.
    seconds
        (G,) time of each group; None if unknown.
    """

    names: tuple[str, ...]
    parts: tuple[RigPart, ...]
    groups: tuple[str, ...]
    seconds: Array | None = None

    @cached_property
    def boards(self) -> int:
        """Number of boards."""
        return 1 + max(part.board for part in self.parts)

    def parts_of(self, camera: int) -> list[int]:
        """Return the indices of the parts of a camera."""
        return [k for k, part in enumerate(self.parts) if part.camera == camera]

    def seen(self) -> Bools:
        """Return (C, G) which groups each camera observes."""
        seen = np.zeros((len(self.names), len(self.groups)), bool)
        for part in self.parts:
            seen[part.camera, part.group] = True
        return seen

    def subset(self, views: Sequence[Bools]) -> Self:
        """Return the observations with only some of the views (V,) of each part; groups keep their indices."""
        parts = tuple(part.subset(np.flatnonzero(kept)) for part, kept in zip(self.parts, views, strict=True))
        return replace(self, parts=parts)

    def split(self, consistent: Sequence[Bools]) -> Self:
        """Return the observations with a group of its own for every view that is not consistent with its group.

        Such a view determines its camera, but no extrinsics. The new groups follow those that exist.
        """
        names, parts, origin = list(self.groups), list[RigPart](), list(range(len(self.groups)))
        for part, kept in zip(self.parts, consistent, strict=True):
            group = part.group.copy()
            for view in np.flatnonzero(~kept):
                origin.append(int(group[view]))
                group[view] = len(names)
                names.append(part.observations.names[view])
            parts.append(replace(part, group=group))
        seconds = None if self.seconds is None else self.seconds[origin]
        return replace(self, parts=tuple(parts), groups=tuple(names), seconds=seconds)

    def of_groups(self, kept: Bools) -> Self:
        """Return the observations of some of the groups (G,), numbered anew."""
        number = np.cumsum(kept) - 1
        parts = tuple(
            replace(part.subset(np.flatnonzero(kept[part.group])), group=number[part.group[kept[part.group]]])
            for part in self.parts
        )
        groups = tuple(name for name, keep in zip(self.groups, kept, strict=True) if keep)
        return replace(self, parts=parts, groups=groups, seconds=None if self.seconds is None else self.seconds[kept])
