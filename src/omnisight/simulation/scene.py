"""A scene of solids, sky, lamps and sun, and its intersection with rays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.parallel import parallel_for
from omnisight.simulation.moving_world import merged_world, moved_tree
from omnisight.simulation.preset_motion import Route
from omnisight.simulation.solids import Solid
from omnisight.simulation.texture import Texture
from omnisight.simulation.traffic import Actor, Parking
from omnisight.simulation.world import SKYLIGHT, SUNLIGHT, Lighting, Point, Surroundings, build_world, illuminate

Array = NDArray[np.float64]

# Rays per task of a thread.
RAYS_PER_TASK = 4096


class Hits(NamedTuple):
    """First intersections of rays with a scene; NaN, and instance 0, where there is none.

    Attributes
    ----------
    distances
        (...) along the bearing from the ray's origin, metres.
    normals
        (..., 3) unit, in the world frame, towards the origin of the ray.
    instances
        (...), 1 + the index in `Scene.names`.
    """

    distances: Array
    normals: Array
    instances: NDArray[np.int32]


class Fog(NamedTuple):
    """Fog: light exp(-extinction t) remains after a distance t, and the fog's own light replaces the rest.

    Attributes
    ----------
    extinction
        Per metre.
    color
        Light of the fog (red, green, blue).
    height
        Of the layer, metres; it covers the sky.
    """

    extinction: float
    color: Point
    height: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene to render: x right, y down, z forward, in metres.

    Attributes
    ----------
    solids
        The objects.
    free
        Low and high corner of a box without solids, in which cameras may move.
    route
        Path of the preset trajectory `loop`; without one, the loop is in `free`.
    sky
        Background as an equirectangular image: forward in the centre, up at the top.
    sun
        Direction to the sun and its strength; it casts sharp shadows.
    sunlight, skylight
        Colours (red, green, blue) of the sun and of the light from all directions; the latter is by default that of a
        blue sky if there is a sun, otherwise white.
    fog
        None for clear air.
    lamps
        Light-emitting discs: centre, radius and strength.
    ambient
        Strength of the light from all directions (ambient occlusion reduces it near solids).
    reach
        Distance, metres, within which solids occlude the ambient light.
    parking
        Where cars may stand; those of visit 0 are among the solids.
    traffic
        Function that returns objects that may move through the scene.
    actors
        Objects that move; `at` returns the scene with them at a time.
    spacing
        Distance between precomputed light samples, metres.
    """

    solids: tuple[Solid, ...]
    free: tuple[Point, Point] = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))
    route: Route | None = None
    sky: Texture | None = None
    sun: tuple[Point, float] = ((0.0, -1.0, 0.0), 0.0)
    sunlight: Point = SUNLIGHT
    skylight: Point | None = None
    fog: Fog | None = None
    lamps: Sequence[tuple[Point, float, float]] = ()
    ambient: float = 1.0
    reach: float = 0.5
    spacing: float = 0.1
    parking: Parking | None = None
    traffic: Callable[[], tuple[Actor, ...]] | None = None
    actors: tuple[Actor, ...] = ()
    # Precomputed light on the faces of each solid.
    _lights: dict[Solid, Any] = field(default_factory=dict[Solid, Any], repr=False)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the objects; the instance number is 1 + the index here."""
        return tuple(dict.fromkeys([solid.name for solid in self.solids] + [actor.name for actor in self.actors]))

    @cached_property
    def _surroundings(self) -> Surroundings:
        fog = (0.0, 0.0, 0.0, 0.0, 0.0) if self.fog is None else (self.fog.extinction, *self.fog.color, self.fog.height)
        skylight = self.skylight or (SKYLIGHT if self.sun[1] > 0 else (1.0, 1.0, 1.0))
        return Surroundings(self.sky, self.sun, self.sunlight, skylight, fog)

    @cached_property
    def _compiled(self) -> tuple[Any, list[Solid]]:
        return build_world(self.solids, self.names, self._surroundings, self.spacing)

    @cached_property
    def world_with_light(self) -> Any:
        """The compiled scene with its precomputed light."""
        world, solids = self._compiled
        lighting = Lighting(self.lamps, self.ambient, self.reach, self.spacing)
        illuminate(world, solids, lighting, self._lights)
        return world

    def at(self, time: float) -> "Scene":
        """Return the scene with its moving objects at a time, seconds; the light on the other solids is unchanged."""
        if not self.actors:
            return self
        solids = [solid for actor in self.actors for solid in actor.at(time)]
        snapshot = replace(self, solids=(*self.solids, *solids), actors=())
        static, merged, order = self._moving
        moved = [solids[i] for i in order]
        world = merged._replace(tree=moved_tree(static.tree, merged.tree, moved))
        # The caches of the snapshot, which would otherwise compile all solids again.
        vars(snapshot).update(_compiled=(world, [*self._compiled[1], *moved]), world_with_light=world)
        return snapshot

    @cached_property
    def _moving(self) -> tuple[Any, Any, list[int]]:
        """The compiled static scene, the one with the moving objects at time 0, and the order of their solids in it."""
        static = self.world_with_light
        solids = [solid for actor in self.actors for solid in actor.at(0.0)]
        moving, ordered = build_world(solids, self.names, self._surroundings, self.spacing)
        merged = merged_world(static, moving, ordered)
        lighting = Lighting(self.lamps, self.ambient, self.reach, self.spacing)
        illuminate(merged, [*self._compiled[1], *ordered], lighting, dict(self._lights))
        number = {solid: i for i, solid in enumerate(solids)}
        return static, merged, [number[solid] for solid in ordered]

    def with_visit(self, visit: int, seed: int = 0) -> "Scene":
        """Return the scene with the cars that are parked at a visit; visit 0 is the scene as it is.

        Raises
        ------
        ValueError
            If no cars are parked in the scene.
        """
        if visit == 0:
            return self
        if self.parking is None:
            raise ValueError(f"--visit {visit} applies only to scenes with parked cars: town")
        names = {spot.name for spot in self.parking.spots}
        kept = [solid for solid in self.solids if solid.name not in names]
        return replace(self, solids=(*kept, *self.parking.solids(seed, visit)), _lights={})

    def with_traffic(self) -> "Scene":
        """Return the scene with its moving objects.

        Raises
        ------
        ValueError
            If the scene has none.
        """
        if self.traffic is None:
            raise ValueError("--traffic applies only to scenes with moving objects: town")
        return replace(self, actors=self.traffic())

    def with_solids(self, solids: Sequence[Solid]) -> "Scene":
        """Return the scene with additional solids; the light on the existing solids is unchanged."""
        self.world_with_light  # noqa: B018  computes the light
        return replace(self, solids=(*self.solids, *solids), _lights=dict(self._lights))

    def cast(self, origins: ArrayLike, bearings: ArrayLike) -> Hits:
        """Intersect rays with the scene, exactly.

        Parameters
        ----------
        origins, bearings
            (..., 3) in the scene frame, bearings of unit length. A NaN bearing meets nothing.

        Raises
        ------
        ValueError
            If the shapes are not (..., 3).
        """
        from omnisight.simulation import _cast

        o, b = np.broadcast_arrays(np.asarray(origins, float), np.asarray(bearings, float))
        if b.ndim < 1 or b.shape[-1] != 3:
            raise ValueError(f"origins and bearings must be (..., 3), got {np.shape(origins)} and {np.shape(bearings)}")
        starts, directions = np.ascontiguousarray(o.reshape(-1, 3)), np.ascontiguousarray(b.reshape(-1, 3))
        count = len(directions)
        distances, normals, instances = np.empty(count), np.empty((count, 3)), np.empty(count, np.int32)
        world, _ = self._compiled
        parallel_for(
            lambda first, last: _cast.cast(
                world, starts, directions, distances, normals, instances, _scratch(), first, last
            ),
            count,
            RAYS_PER_TASK,
        )
        lead = b.shape[:-1]
        return Hits(distances.reshape(lead), normals.reshape(*lead, 3), instances.reshape(lead))

    def solids_at(self, points: ArrayLike) -> list[str]:
        """Return the name of the solid that contains each of points (N, 3), or "" for free space.

        A point outside a room is in the room's walls. Rectangles contain nothing.
        """
        x = np.asarray(points, float).reshape(-1, 3)
        names = np.full(len(x), "", object)
        for solid in self.solids:
            names[solid.contains(x) != solid.inside] = solid.name
        return names.tolist()

    def instance(self, name: str) -> int:
        """Return the instance number of a name.

        Raises
        ------
        ValueError
            If no solid has the name.
        """
        if name not in self.names:
            raise ValueError(f"no object {name!r} in the scene; choose one of: {', '.join(self.names)}")
        return self.names.index(name) + 1


def _scratch() -> tuple[Array, Array, NDArray[np.int64]]:
    """Return the working memory of a thread for a packet of rays; see `_cast.cast`."""
    from omnisight.simulation._cast import PACKET

    return np.empty((2, PACKET, 3)), np.empty(PACKET), np.empty((PACKET, 2), np.int64)
