"""A box-shaped room whose six faces are pictures."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from omnisight.simulate.walls import furnish

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Point = tuple[float, float, float]

# A face is seen from inside, its picture's u to the right and v down: the axis it bounds and whether at its high end,
# then the axes along u and v, each with whether it runs with the world's.
FACES = {
    "front": (2, True, (0, True), (1, True)),
    "right": (0, True, (2, False), (1, True)),
    "back": (2, False, (0, False), (1, True)),
    "left": (0, False, (2, True), (1, True)),
    "floor": (1, True, (0, True), (2, False)),
    "ceiling": (1, False, (0, True), (2, True)),
}


@dataclass(frozen=True)
class Room:
    """A room to take pictures in: x right, y down, z forward, in metres.

    Attributes
    ----------
    low, high
        Opposite corners; the origin lies inside, at the height of a tripod's head.
    pictures
        Each face's picture (h, w, 3) uint8 RGB as seen from inside; furnished unless given.
    """

    low: Point = (-2.7, -1.3, -2.3)
    high: Point = (2.7, 1.3, 2.9)
    pictures: Mapping[str, Bytes] = field(default_factory=dict[str, Bytes])

    def __post_init__(self) -> None:
        """Furnish the room unless it was."""
        if not self.pictures:
            width, height, depth = (b - a for a, b in zip(self.low, self.high, strict=True))
            object.__setattr__(self, "pictures", furnish(width, height, depth))

    @classmethod
    def plain(cls, colour: tuple[int, int, int] = (128, 128, 128)) -> "Room":
        """Give a room of one colour."""
        return cls(pictures={name: np.full((2, 2, 3), colour, np.uint8) for name in FACES})

    def colours(self, origin: NDArray[np.float64], rays: Floats) -> Floats:
        """Give what rays from a point inside meet.

        Parameters
        ----------
        origin
            (3,).
        rays
            (rows, columns, 3) in the room's frame, of any length but 0.

        Returns
        -------
        (rows, columns, 3), 0 to 255; anything where a ray is NaN.

        Raises
        ------
        ValueError
            If the point lies outside.
        """
        import cv2

        low, high = np.array(self.low, np.float32), np.array(self.high, np.float32)
        eye = np.asarray(origin, np.float32)
        if not ((low < eye) & (eye < high)).all():
            raise ValueError(f"the camera must be inside the room, {self.low} to {self.high}, got {eye.tolist()}")
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            distance = (np.where(rays > 0, high, low) - eye) / rays
            axis = np.argmin(np.where(rays == 0, np.inf, distance), -1)
            reach = np.take_along_axis(distance, axis[..., None], -1)
            hit = np.nan_to_num(eye + reach * rays).astype(np.float32)
        ahead = np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0
        result = np.zeros(rays.shape, np.float32)
        for name, (bound, at_high, across, down) in FACES.items():
            here = (axis == bound) & (ahead == at_high)
            if not here.any():
                continue
            picture = self.pictures[name]
            u, v = (
                self._along(hit, *line) * np.float32(length)
                for line, length in ((across, picture.shape[1]), (down, picture.shape[0]))
            )
            seen = cv2.remap(picture, u - 0.5, v - 0.5, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            np.copyto(result, seen, where=here[..., None])
        return result

    def _along(self, hit: Floats, axis: int, forward: bool) -> Floats:
        """Give how far along a face (0 to 1) rays meet it."""
        share = (hit[..., axis] - np.float32(self.low[axis])) / np.float32(self.high[axis] - self.low[axis])
        return np.clip(share if forward else 1 - share, 0, 1).astype(np.float32)
