"""Shapes and text of a printed page."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Polygon:
    """A filled polygon by its corners in metres, x right and y down; black unless `white`."""

    corners: tuple[tuple[float, float], ...]
    white: bool = False


@dataclass(frozen=True)
class Disc:
    """A filled disc by its centre and radius in metres; black unless `white`."""

    centre: tuple[float, float]
    radius: float
    white: bool = False


Shape = Polygon | Disc


@dataclass(frozen=True)
class Text:
    """A line of black Helvetica: left end of the baseline, font size in metres, and text."""

    at: tuple[float, float]
    size: float
    content: str


@dataclass(frozen=True)
class Page:
    """A sheet of paper and its content, in metres from its top left corner.

    Attributes
    ----------
    title : str
    width, height : float
    board : tuple of Shape
        The board, painted in order.
    origin : (float, float)
        Position of the origin of the board's `points`.
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
    """Return a rectangle with a top left corner and sides, in metres."""
    right, bottom = left + width, top + height
    return Polygon(((left, top), (right, top), (right, bottom), (left, bottom)), white)


def translated(shape: Shape, x: float, y: float) -> Shape:
    """Return a shape moved right by x and down by y, in metres."""
    if isinstance(shape, Disc):
        return replace(shape, centre=(shape.centre[0] + x, shape.centre[1] + y))
    return replace(shape, corners=tuple((a + x, b + y) for a, b in shape.corners))
