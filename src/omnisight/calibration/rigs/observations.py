"""Boards that the cameras of a rig observed, and which of the images are simultaneous."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.display import Displayed
from omnisight.targets.observations import Observations

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.intp]

# Unit of a view that agrees with its group.
AGREES = -1


@dataclass(frozen=True, eq=False)
class RigPart(Displayed):
    """All views of one board by one camera.

    Attributes
    ----------
    camera, board
        Indices of the camera and of the board.
    observations
        The views; each is one board in one image.
    group
        (V,) index of the pose that each view observes: views of the same group share it.
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
class RigObservations(Displayed):
    """Boards that the cameras of a rig observed.

    A group is the boards of one rigid set at one time: all views of a group share its pose.

    Attributes
    ----------
    names
        Name of each camera.
    parts
        The views, by camera and board.
    groups
        Name of each group: that of its first image.
    frame
        (G,) time at which each group was observed, as an index; the groups of one time are of different sets of boards,
        or contradict each other.
    boards
        Name of each board.
    unit
        (G,) camera or board whose views contradict the others of their time, see `unit_of`; `AGREES` for all others.
    seconds
        (G,) time of each group; None if unknown.
    """

    names: tuple[str, ...]
    parts: tuple[RigPart, ...]
    groups: tuple[str, ...]
    frame: Indices
    boards: tuple[str, ...]
    unit: Indices
    seconds: Array | None = None

    def parts_of(self, camera: int) -> list[int]:
        """Return the indices of the parts of a camera."""
        return [k for k, part in enumerate(self.parts) if part.camera == camera]

    def unit_of(self, kind: str, index: int) -> int:
        """Return the number of a "camera" or a "board" among all that can contradict a group."""
        return index + (len(self.names) if kind == "board" else 0)

    def seen(self) -> Bools:
        """Return (C, G) which groups each camera observes."""
        seen = np.zeros((len(self.names), len(self.groups)), bool)
        for part in self.parts:
            seen[part.camera, part.group] = True
        return seen

    def common_frames(self, a: int, b: int) -> Indices:
        """Return the times at which two cameras observe a group together, ascending."""
        seen = self.seen()
        return np.unique(self.frame[seen[a] & seen[b]])

    @cached_property
    def exposures(self) -> tuple[Indices, Indices]:
        """Camera and group of each exposure: the views of one group by one camera; sorted by camera."""
        pairs = {(part.camera, group) for part in self.parts for group in part.group.tolist()}
        camera, group = np.array(sorted(pairs), np.intp).reshape(-1, 2).T
        return camera, group

    def exposures_of(self, part: RigPart) -> Indices:
        """Return the exposure (V,) of each view of a part."""
        camera, group = self.exposures
        return np.searchsorted(camera * len(self.groups) + group, part.camera * len(self.groups) + part.group)

    def subset(self, views: Sequence[Bools]) -> Self:
        """Return the observations with only some of the views (V,) of each part; groups keep their indices."""
        parts = tuple(part.subset(np.flatnonzero(kept)) for part, kept in zip(self.parts, views, strict=True))
        return replace(self, parts=parts)

    def split(self, units: Sequence[Indices]) -> Self:
        """Return the observations with a group of its own for the views of every unit that contradicts its group.

        The views of a camera then determine it, but no extrinsics; those of a board no relation to other boards. The
        new groups follow those that exist.

        Parameters
        ----------
        units
            For each part (V,) the unit with which each view contradicts its group, or `AGREES`.
        """
        names, parts = list(self.groups), list[RigPart]()
        number = dict[tuple[int, int], int]()
        for part, unit in zip(self.parts, units, strict=True):
            group = part.group.copy()
            for view in np.flatnonzero(unit != AGREES):
                key = int(group[view]), int(unit[view])
                if key not in number:
                    number[key] = len(names)
                    names.append(part.observations.names[view])
                group[view] = number[key]
            parts.append(replace(part, group=group))
        origin = [*range(len(self.groups)), *(group for group, _ in number)]
        return replace(
            self,
            parts=tuple(parts),
            groups=tuple(names),
            frame=self.frame[origin],
            unit=np.concatenate([self.unit, np.array([unit for _, unit in number], np.intp)]),
            seconds=None if self.seconds is None else self.seconds[origin],
        )

    def of_groups(self, kept: Bools) -> Self:
        """Return the observations of some of the groups (G,), numbered anew."""
        number = np.cumsum(kept) - 1
        parts = tuple(
            replace(part.subset(np.flatnonzero(kept[part.group])), group=number[part.group[kept[part.group]]])
            for part in self.parts
        )
        return replace(
            self,
            parts=parts,
            groups=tuple(name for name, keep in zip(self.groups, kept, strict=True) if keep),
            frame=self.frame[kept],
            unit=self.unit[kept],
            seconds=None if self.seconds is None else self.seconds[kept],
        )

    def with_rigid_sets(self, sets: Sequence[int]) -> Self:
        """Return the observations with one group for each time and set of rigidly connected boards.

        Parameters
        ----------
        sets
            (B,) number of the set of each board.
        """
        keys = [[(int(self.frame[g]), sets[part.board]) for g in part.group] for part in self.parts]
        number = {key: k for k, key in enumerate(sorted({key for part in keys for key in part}))}
        origin = dict[int, int]()
        parts = list[RigPart]()
        for part, own in zip(self.parts, keys, strict=True):
            group = np.array([number[key] for key in own], np.intp)
            for new, old in zip(group.tolist(), part.group.tolist(), strict=True):
                origin[new] = min(old, origin.get(new, old))
            parts.append(replace(part, group=group))
        first = [origin[k] for k in range(len(number))]
        return replace(
            self,
            parts=tuple(parts),
            groups=tuple(self.groups[g] for g in first),
            frame=self.frame[first],
            unit=self.unit[first],
            seconds=None if self.seconds is None else self.seconds[first],
        )
