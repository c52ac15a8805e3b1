"""ArUco and AprilTag markers: OpenCV's dictionaries, the cells of a marker, and its shapes for printing."""

import difflib
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.printing.drawing import Polygon, Shape, rectangle

Cells = NDArray[np.bool_]


@cache
def dictionary_named(name: str) -> Any:
    """Return OpenCV's predefined dictionary, such as DICT_5X5_100; raise ValueError if there is none."""
    import cv2

    if name not in dir(cv2.aruco) or not name.startswith("DICT_"):
        raise ValueError(f"unknown dictionary of markers {name!r}; {_suggestion(name)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def full_name(text: str) -> str:
    """Return OpenCV's name of a dictionary written as 4x4_50 or dict_4X4_50; unknown names stay as they are."""
    known = {name.upper(): name for name in dictionary_names()}
    upper = text.strip().upper()
    return known.get(upper) or known.get(f"DICT_{upper}") or text


def dictionary_names() -> tuple[str, ...]:
    """Return OpenCV's names of the dictionaries."""
    import cv2

    return tuple(sorted({name.upper(): name for name in dir(cv2.aruco) if name.startswith("DICT_")}.values()))


def _suggestion(text: str) -> str:
    """Return a question with the dictionaries of similar name, or examples."""
    names = {name.upper(): name for name in dictionary_names()}
    bare = text.strip().upper().removeprefix("DICT_")
    close = [name for upper, name in names.items() if len(bare) > 2 and bare in upper]
    close = close or [names[name] for name in difflib.get_close_matches(f"DICT_{bare[:40]}", names, cutoff=0.75)]
    close.sort(key=lambda name: [int(part) if part.isdigit() else 0 for part in name.split("_")])
    if not close:
        return "use one of OpenCV's, such as DICT_5X5_100 or DICT_4X4_50"
    return f"did you mean {', '.join(close[:-1])}{' or ' if close[1:] else ''}{close[-1]}?"


def marker_count(name: str) -> int:
    """Return the number of markers of a dictionary."""
    return len(dictionary_named(name).bytesList)


def marker_cells(name: str, marker: int, *, border: int = 1) -> Cells:
    """Return which cells (N, N) of a marker are white, its black border of `border` cells included."""
    import cv2

    dictionary = dictionary_named(name)
    side = dictionary.markerSize + 2 * border
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, marker, side, borderBits=border)) > 127


def cell_shapes(cells: Cells, left: float, top: float, side: float) -> list[Shape]:
    """Return a marker as a black square, the outlines of its white parts, of the black in those, and so on.

    One square per cell would show hairlines between squares on a screen.

    Parameters
    ----------
    cells : (N, N) array of bool
        True where white; the border is black.
    left, top, side : float
        Position and side of the marker, in metres.
    """
    scale = side / len(cells)
    shapes: list[Shape] = [rectangle(left, top, side, side)]
    # What lies inside another outline has less area, so it is painted later.
    for corners in sorted(_outlines(cells), key=lambda c: -abs(_area(c))):
        placed = tuple((left + x * scale, top + y * scale) for x, y in corners)
        shapes.append(Polygon(placed, white=_area(corners) > 0))
    return shapes


def _outlines(cells: Cells) -> list[list[tuple[int, int]]]:
    """Trace all white parts, clockwise around white and anticlockwise around black inside."""
    edges = {
        (x + i, y + j, dx, dy)
        for y, x in np.argwhere(cells).tolist()
        for i, j, dx, dy in ((0, 0, 1, 0), (1, 0, 0, 1), (1, 1, -1, 0), (0, 1, 0, -1))
        if not cells[y - dx, x + dy]
    }
    outlines: list[list[tuple[int, int]]] = []
    while edges:
        corners: list[tuple[int, int]] = []
        visited: set[tuple[int, int, int, int]] = set()
        edge = start = min(edges)
        while not visited or edge != start:
            visited.add(edge)
            x, y, dx, dy = edge
            x, y = x + dx, y + dy
            # Where two white cells touch at a corner, the sharpest turn stays with the same cell.
            turns = (-dy, dx), (dx, dy), (dy, -dx)
            edge = next((x, y, *turn) for turn in turns if (x, y, *turn) in edges)
            if edge[2:] != (dx, dy):
                corners.append((x, y))
        edges -= visited
        outlines.append(corners)
    return outlines


def _area(corners: list[tuple[int, int]]) -> float:
    """Return the enclosed area, negative for an anticlockwise outline."""
    x, y = np.array(corners).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
