"""What a printed board is made of: shapes and words on a page."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Polygon:
    """A filled polygon: its corners in metres, x right and y down, black unless `white`."""

    corners: tuple[tuple[float, float], ...]
    white: bool = False


@dataclass(frozen=True)
class Disc:
    """A filled disc: middle and radius in metres, black unless `white`."""

    centre: tuple[float, float]
    radius: float
    white: bool = False


Shape = Polygon | Disc


@dataclass(frozen=True)
class Text:
    """A line of black Helvetica: the left end of its baseline and the size of its letters, in metres."""

    at: tuple[float, float]
    size: float
    words: str


@dataclass(frozen=True)
class Page:
    """A sheet of paper: width and height in metres, and what is on it, in metres from its top left corner.

    Attributes
    ----------
    title : str
    width, height : float
    board : tuple of Shape
        The board, painted in order.
    origin : (float, float)
        Where the origin of the board's `points` is.
    ruler : tuple of Shape
    texts : tuple of Text
    """

    title: str
    width: float
    height: float
    board: tuple[Shape, ...]
    origin: tuple[float, float]
    ruler: tuple[Shape, ...] = ()
    texts: tuple[Text, ...] = ()


def rectangle(left: float, top: float, width: float, height: float, *, white: bool = False) -> Polygon:
    """Give a rectangle by its top left corner and its sides, in metres."""
    right, bottom = left + width, top + height
    return Polygon(((left, top), (right, top), (right, bottom), (left, bottom)), white)


def moved(shape: Shape, x: float, y: float) -> Shape:
    """Give the shape moved to the right and down, in metres."""
    if isinstance(shape, Disc):
        return replace(shape, centre=(shape.centre[0] + x, shape.centre[1] + y))
    return replace(shape, corners=tuple((a + x, b + y) for a, b in shape.corners))
