"""Streets and crossings of a town: each in a frame of its own, x right, y down, z along the street."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import exp
from omnisight.simulation.procedural_textures import materials, outdoors
from omnisight.simulation.solids import Solid, box, rectangle
from omnisight.simulation.texture import Texture

Array = NDArray[np.float64]
Rng = np.random.Generator

# Height of the origin above the road, half widths of the road and of the street, and the side of a house's lot.
GROUND, KERB, WALL, LOT = 1.6, 3.6, 7.0, 9.0
# Height of the kerb, and length of the road that a texture covers.
STEP, ROAD_PIECE = 0.12, 18.0
DENSITY = outdoors.PIXELS_PER_METRE


class Frame(NamedTuple):
    """Origin (x, z) in the world and yaw of a street."""

    origin: tuple[float, float]
    yaw: float


@dataclass(frozen=True)
class Street:
    """A straight street of uniform slope.

    Attributes
    ----------
    frame
        Its start.
    length
        Metres.
    start_height, end_height
        Heights of its ends above the ground of the world's origin.
    skips_corners
        Whether the first and the last lot belong to crossing streets.
    ends
        Whether it is a dead end.
    """

    frame: Frame
    length: float
    start_height: float
    end_height: float
    skips_corners: bool = False
    ends: bool = False

    @property
    def slope(self) -> float:
        """Rise per metre."""
        return (self.end_height - self.start_height) / self.length

    def pose(self, x: float, z: float, yaw: float, *, at: float | None = None, lift: float = 0.0) -> Pose:
        """Return the pose of an upright object at (x, z), on the ground there or at another z."""
        height = self.start_height + self.slope * (z if at is None else at) + lift
        turn = exp(np.array((0, self.frame.yaw, 0)))
        place = turn @ np.array((x, 0, z)) + (self.frame.origin[0], GROUND - height, self.frame.origin[1])
        return Pose(turn @ exp(np.array((0, yaw, 0))), place)

    def shear(self) -> Array:
        """Return the affine transform (3, 4) from the street's frame, ground at y = 0, to the world."""
        turn = exp(np.array((0, self.frame.yaw, 0)))
        turn[1, 2] -= self.slope
        x, z = self.frame.origin
        return np.column_stack([turn, (x, GROUND - self.start_height, z)])


@dataclass(frozen=True, eq=False)
class StreetTextures:
    """Images of the ground: road pieces, zebra crossing, asphalt, pavement along streets and at corners, kerb."""

    roads: tuple[NDArray[np.uint8], ...]
    zebra: Texture
    asphalt: Texture
    pavement: NDArray[np.uint8]
    corner: Texture
    kerb: Texture


def street_textures(rng: Rng) -> StreetTextures:
    """Draw the textures of the ground, which all streets share."""
    roads = tuple(outdoors.road(rng, 2 * KERB, ROAD_PIECE, crossings=()) for _ in range(2))
    stone = (164, 160, 152)
    return StreetTextures(
        roads,
        Texture(outdoors.zebra_crossing(rng, 2 * KERB, WALL - KERB)),
        Texture(materials.asphalt(rng, 2 * KERB, 2 * KERB, DENSITY)),
        materials.paving(rng, WALL - KERB, ROAD_PIECE / 2, 0.5, DENSITY, stone),
        Texture(materials.paving(rng, WALL - KERB, WALL - KERB, 0.5, DENSITY, stone)),
        Texture(materials.paving(rng, 4.0, 0.3, 0.8, DENSITY, (150, 148, 144))),
    )


def roadway(street: Street, textures: StreetTextures, name: str) -> list[Solid]:
    """Return the road and the pavements of a street."""
    pieces = round(street.length / ROAD_PIECE)
    road = Texture(textures.roads[int(street.frame.yaw != 0)], (1, pieces))
    pavement = Texture(textures.pavement, (1, 2 * pieces))
    solids = [_ground(-KERB, KERB, 0.0, street.length, 0.0, road, name)]
    for side in (-1, 1):
        x0, x1 = sorted((side * KERB, side * WALL))
        solids.append(_ground(x0, x1, 0.0, street.length, -STEP, pavement, f"{name} pavement {side}"))
        x0, x1 = sorted((side * KERB, side * (KERB + 0.12)))
        low, high = (x0, -STEP - 0.001, 0.0), (x1, 0.0, street.length)
        solids.append(box(low, high, textures.kerb, f"{name} pavement {side}"))
    return [_transformed(solid, street.shear()) for solid in solids]


def crossing(frame: Frame, height: float, textures: StreetTextures, name: str) -> list[Solid]:
    """Return a crossing: its centre, four zebra crossings and four corners of pavement."""
    solids = [_ground(-KERB, KERB, -KERB, KERB, 0.0, textures.asphalt, name)]
    arms: list[Solid] = [_ground(-KERB, KERB, KERB, WALL, 0.0, textures.zebra, name)]
    arms.append(_ground(KERB, WALL, KERB, WALL, -STEP, textures.corner, f"{name} pavement"))
    for low, high in (
        ((KERB, -STEP - 0.001, KERB), (KERB + 0.12, 0.0, WALL)),
        ((KERB + 0.12, -STEP - 0.001, KERB), (WALL, 0.0, KERB + 0.12)),
    ):
        arms.append(box(low, high, textures.kerb, f"{name} pavement"))
    for quarter in range(4):
        turn = Pose(exp(np.array((0, quarter * np.pi / 2, 0))))
        solids += [solid.moved(turn) for solid in arms]
    x, z = frame.origin
    return [solid.moved(Pose(translation=np.array((x, GROUND - height, z)))) for solid in solids]


def _ground(x0: float, x1: float, z0: float, z1: float, y: float, texture: Texture, name: str) -> Solid:
    return rectangle((x0, y, z1), (x1 - x0, 0, 0), (0, 0, z0 - z1), texture, name)


def _transformed(solid: Solid, affine: Array) -> Solid:
    """Return a solid after an affine transform (3, 4)."""
    matrix = affine[:, :3] @ solid.world_from_local
    matrix[:, 3] += affine[:, 3]
    return replace(solid, world_from_local=matrix)
