"""The square markers with bits inside, as shapes to print; the bits are OpenCV's."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.printing.drawing import Polygon, Shape, rectangle

Cells = NDArray[np.bool_]


@cache
def dictionary_named(name: str) -> Any:
    """Give OpenCV's predefined dictionary of that name, such as DICT_5X5_100; ValueError if there is none."""
    import cv2

    names = sorted({n.upper(): n for n in dir(cv2.aruco) if n.startswith("DICT_")}.values())
    if name not in dir(cv2.aruco) or not name.startswith("DICT_"):
        raise ValueError(f"unknown dictionary of markers {name!r}; there are: {', '.join(names)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def marker_count(name: str) -> int:
    """Give how many markers the dictionary of that name has."""
    return len(dictionary_named(name).bytesList)


def marker_cells(name: str, marker: int, *, border: int = 1) -> Cells:
    """Give which cells (N, N) of a marker are white, its black border of so many cells included."""
    import cv2

    dictionary = dictionary_named(name)
    side = dictionary.markerSize + 2 * border
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, marker, side, borderBits=border)) > 127


def cell_shapes(cells: Cells, left: float, top: float, side: float) -> list[Shape]:
    """Give the shapes of a marker: a black square, the outlines of its white parts, of the black in those, and so on.

    Not one square for each cell: a screen shows hairlines between squares that touch.

    Parameters
    ----------
    cells : (N, N) array of bool
        True where white; the border is black.
    left, top, side : float
        Where the marker is and how large, in metres.
    """
    scale = side / len(cells)
    shapes: list[Shape] = [rectangle(left, top, side, side)]
    # What lies inside another outline has less area, so it is painted later.
    for corners in sorted(_outlines(cells), key=lambda c: -abs(_area(c))):
        placed = tuple((left + x * scale, top + y * scale) for x, y in corners)
        shapes.append(Polygon(placed, white=_area(corners) > 0))
    return shapes


def _outlines(cells: Cells) -> list[list[tuple[int, int]]]:
    """Walk around all white parts, white on the right hand: clockwise around it, anticlockwise around black inside."""
    edges = {
        (x + i, y + j, dx, dy)
        for y, x in np.argwhere(cells).tolist()
        for i, j, dx, dy in ((0, 0, 1, 0), (1, 0, 0, 1), (1, 1, -1, 0), (0, 1, 0, -1))
        if not cells[y - dx, x + dy]
    }
    outlines: list[list[tuple[int, int]]] = []
    while edges:
        corners: list[tuple[int, int]] = []
        walked: set[tuple[int, int, int, int]] = set()
        edge = start = min(edges)
        while not walked or edge != start:
            walked.add(edge)
            x, y, dx, dy = edge
            x, y = x + dx, y + dy
            # Where two white cells touch at a corner, the sharpest turn stays with the same cell.
            turns = (-dy, dx), (dx, dy), (dy, -dx)
            edge = next((x, y, *turn) for turn in turns if (x, y, *turn) in edges)
            if edge[2:] != (dx, dy):
                corners.append((x, y))
        edges -= walked
        outlines.append(corners)
    return outlines


def _area(corners: list[tuple[int, int]]) -> float:
    """Give the area inside, negative where the corners run anticlockwise."""
    x, y = np.array(corners).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
