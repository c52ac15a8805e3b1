"""A scene: solids, the sky, lamps and the sun; and what rays meet in it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.parallel import parallel_for
from omnisight.simulation.solids import Solid
from omnisight.simulation.texture import Texture

Array = NDArray[np.float64]
Point = tuple[float, float, float]

GRAIN = 4096  # rays worth a thread


class Hits(NamedTuple):
    """What rays meet, each figure NaN (the instance 0) where they meet nothing.

    Attributes
    ----------
    distances
        (...) along the bearing from the ray's origin, metres.
    normals
        (..., 3) unit, in the world's frame, towards where the ray comes from.
    instances
        (...), 1 + the place in `Scene.names` of what is met.
    """

    distances: Array
    normals: Array
    instances: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Scene:
    """A place to take images of: x right, y down, z forward, in metres.

    Attributes
    ----------
    solids
        What stands there.
    free
        Low and high corner of a box in which nothing stands: there a camera may move.
    sky
        What is seen past everything, as an image of all directions: forward in the middle, up at the top.
    sun
        Direction to the sun and its strength; it casts sharp shadows.
    lamps
        Discs that shine: middle, radius, and strength.
    ambient
        The light from all around; it reaches less where solids stand within `reach`, metres.
    reach
        See `ambient`.
    spacing
        Of the places at which light is worked out beforehand, metres.
    """

    solids: tuple[Solid, ...]
    free: tuple[Point, Point] = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    sky: Texture | None = None
    sun: tuple[Point, float] = ((0.0, -1.0, 0.0), 0.0)
    lamps: Sequence[tuple[Point, float, float]] = ()
    ambient: float = 1.0
    reach: float = 0.5
    spacing: float = 0.1
    # What falls on each face of a solid, once it is worked out.
    _lights: dict[Solid, Any] = field(default_factory=dict[Solid, Any], repr=False)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What there is, by name; an instance's number is 1 + its place here."""
        return tuple(dict.fromkeys(solid.name for solid in self.solids))

    @cached_property
    def _built(self) -> tuple[Any, list[Solid]]:
        from omnisight.simulation.world import build

        return build(self)

    @cached_property
    def lit(self) -> Any:
        """The scene as the compiled loops see it, with its light, which is worked out once."""
        from omnisight.simulation.world import illuminate

        world, solids = self._built
        illuminate(self, world, solids, self._lights)
        return world

    def holding(self, solids: Sequence[Solid]) -> "Scene":
        """Give the scene with more in it; the light on what was there stays as it was."""
        self.world_with_light  # noqa: B018  works out the light
        return replace(self, solids=(*self.solids, *solids), _lights=dict(self._lights))

    def cast(self, origins: ArrayLike, bearings: ArrayLike) -> Hits:
        """Give what rays meet, exactly.

        Parameters
        ----------
        origins, bearings
            (..., 3) in the scene's frame, bearings of unit length. Where a bearing is NaN nothing is met.

        Raises
        ------
        ValueError
            If the shapes are not (..., 3).
        """
        from omnisight.simulation import _trace

        o, b = np.broadcast_arrays(np.asarray(origins, float), np.asarray(bearings, float))
        if b.ndim < 1 or b.shape[-1] != 3:
            raise ValueError(f"origins and bearings must be (..., 3), got {np.shape(origins)} and {np.shape(bearings)}")
        starts, ways = np.ascontiguousarray(o.reshape(-1, 3)), np.ascontiguousarray(b.reshape(-1, 3))
        count = len(ways)
        distances, normals, instances = np.empty(count), np.empty((count, 3)), np.empty(count, np.int32)
        world, _ = self._built
        parallel_for(
            lambda first, last: _trace.cast(world, starts, ways, distances, normals, instances, first, last),
            count,
            GRAIN,
        )
        lead = b.shape[:-1]
        return Hits(distances.reshape(lead), normals.reshape(*lead, 3), instances.reshape(lead))

    def what_holds(self, points: ArrayLike) -> list[str]:
        """Say for each of points (N, 3) in which solid it lies, or past which wall; "" where a camera may be.

        A rectangle, which has no inside, holds nothing.
        """
        x = np.asarray(points, float).reshape(-1, 3)
        holder = np.full(len(x), "", object)
        for solid in self.solids:
            holder[solid.contains(x) != solid.inside] = solid.name
        return holder.tolist()

    def instance(self, name: str) -> int:
        """Give the number of what has a name.

        Raises
        ------
        ValueError
            If nothing has it.
        """
        if name not in self.names:
            raise ValueError(f"there is no {name!r} in the scene; there are {', '.join(self.names)}")
        return self.names.index(name) + 1
