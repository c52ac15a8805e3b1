"""The primitives of scenes: affinely transformed unit shapes with a texture on each face."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.pose import Pose
from omnisight.simulation.texture import Texture

Array = NDArray[np.float64]

FACES = {
    "rectangle": ("front",),
    "box": ("left", "right", "top", "bottom", "near", "far"),
    "ellipsoid": ("surface",),
    "cylinder": ("side", "top", "bottom"),
    "roof": ("near", "far", "left", "right", "bottom"),
}
# Low and high corner of each shape in its own frame.
BOUNDS = {
    "ellipsoid": ((-1, -1, -1), (1, 1, 1)),
    "cylinder": ((-1, 0, -1), (1, 1, 1)),
    "rectangle": ((0, 0, 0), (1, 1, 0)),
}
UNIT = ((0, 0, 0), (1, 1, 1))


@dataclass(frozen=True, eq=False)
class Solid:
    """A transformed shape.

    Attributes
    ----------
    shape
        A key of `FACES`.
    world_from_local
        (3, 4) affine transform; the columns are the axes of the unit shape and its origin in the world, metres.
    textures
        One for each face, in the order of `FACES`.
    name
        Name of the object; solids with the same name are one instance.
    inside
        Whether it is seen from inside, as a room is.
    glow
        Emitted light (1 shows the texture unchanged); None if it only reflects.
    """

    shape: str
    world_from_local: Array
    textures: tuple[Texture, ...]
    name: str
    inside: bool = False
    glow: float | None = None

    def moved(self, pose: Pose) -> "Solid":
        """Return the solid transformed by a pose."""
        matrix = np.column_stack([pose.rotation @ self.world_from_local[:, :3], pose @ self.world_from_local[:, 3]])
        return replace(self, world_from_local=matrix)

    def bounds(self) -> tuple[Array, Array]:
        """Return the low and the high corner of its bounding box."""
        low, high = np.array(BOUNDS.get(self.shape, UNIT), float)
        matrix, origin = self.world_from_local[:, :3], self.world_from_local[:, 3]
        middle = matrix @ ((low + high) / 2) + origin
        half = np.abs(matrix) @ ((high - low) / 2)
        return middle - half, middle + half

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Return which points (..., 3) of the world are inside the shape."""
        linear, origin = self.world_from_local[:, :3], self.world_from_local[:, 3]
        x, y, z = np.moveaxis((points - origin) @ np.linalg.inv(linear).T, -1, 0)
        if self.shape == "ellipsoid":
            return x * x + y * y + z * z < 1
        if self.shape == "cylinder":
            return (x * x + z * z < 1) & (y > 0) & (y < 1)
        inside = (x > 0) & (x < 1) & (y > 0) & (y < 1) & (z > 0) & (z < 1)
        if self.shape == "roof":
            return inside & (y > np.abs(1 - 2 * z))
        return inside & (self.shape == "box")


def rectangle(corner: ArrayLike, across: ArrayLike, down: ArrayLike, texture: Texture, name: str) -> Solid:
    """Make a flat image from its top left corner and its two sides; only the front is lit."""
    a, d = np.asarray(across, float), np.asarray(down, float)
    normal = np.cross(a, d)
    return Solid(
        "rectangle", np.column_stack([a, d, normal / np.linalg.norm(normal), np.asarray(corner)]), (texture,), name
    )


def box(
    low: ArrayLike,
    high: ArrayLike,
    textures: Texture | Mapping[str, Texture],
    name: str,
    *,
    inside: bool = False,
    glow: float | None = None,
) -> Solid:
    """Make an axis-aligned box; `textures` maps names of `FACES` to textures, "other" those of the remaining faces."""
    origin, size = np.asarray(low, float), np.asarray(high, float) - np.asarray(low, float)
    matrix = np.column_stack([np.diag(size), origin])
    return Solid("box", matrix, _by_face("box", textures), name, inside, glow)


def ellipsoid(
    centre: ArrayLike, radii: float | Sequence[float], texture: Texture, name: str, *, glow: float | None = None
) -> Solid:
    """Make a sphere, or an axis-aligned ellipsoid from three radii."""
    matrix = np.column_stack([np.diag(np.broadcast_to(np.asarray(radii, float), 3)), np.asarray(centre, float)])
    return Solid("ellipsoid", matrix, (texture,), name, glow=glow)


def cylinder(
    start: ArrayLike,
    end: ArrayLike,
    radius: float,
    textures: Texture | Mapping[str, Texture],
    name: str,
    *,
    glow: float | None = None,
) -> Solid:
    """Make a closed cylinder from the centres of its caps, "top" and "bottom"."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    axis = b - a
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside *= radius / np.linalg.norm(aside)
    third = np.cross(aside, axis)
    third *= radius / np.linalg.norm(third)
    return Solid("cylinder", np.column_stack([aside, axis, third, a]), _by_face("cylinder", textures), name, glow=glow)


def roof(low: ArrayLike, high: ArrayLike, textures: Texture | Mapping[str, Texture], name: str) -> Solid:
    """Make a gable roof in a box, with its ridge along x."""
    origin, size = np.asarray(low, float), np.asarray(high, float) - np.asarray(low, float)
    return Solid("roof", np.column_stack([np.diag(size), origin]), _by_face("roof", textures), name)


def _by_face(shape: str, textures: Texture | Mapping[str, Texture]) -> tuple[Texture, ...]:
    if isinstance(textures, Texture):
        return (textures,) * len(FACES[shape])
    return tuple(textures[face] if face in textures else textures["other"] for face in FACES[shape])
