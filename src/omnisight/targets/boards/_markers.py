"""The square markers with bits inside, as shapes to print; the bits are OpenCV's."""

from __future__ import annotations

import difflib
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

    if name not in dir(cv2.aruco) or not name.startswith("DICT_"):
        raise ValueError(f"unknown dictionary of markers {name!r}; {_meant(name)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def full_name(text: str) -> str:
    """Give OpenCV's name of the dictionary that a user writes as 4x4_50 or dict_4X4_50; as it is if there is none."""
    known = {name.upper(): name for name in _names()}
    upper = text.strip().upper()
    return known.get(upper) or known.get(f"DICT_{upper}") or text


def _names() -> list[str]:
    import cv2

    return sorted({name.upper(): name for name in dir(cv2.aruco) if name.startswith("DICT_")}.values())


def _meant(text: str) -> str:
    """Ask for the dictionaries whose names are like that; say how they are called if none is."""
    names = {name.upper(): name for name in _names()}
    bare = text.strip().upper().removeprefix("DICT_")
    close = [name for upper, name in names.items() if len(bare) > 2 and bare in upper]
    close = close or [names[name] for name in difflib.get_close_matches(f"DICT_{bare[:40]}", names, cutoff=0.75)]
    close.sort(key=lambda name: [int(part) if part.isdigit() else 0 for part in name.split("_")])
    if not close:
        return "give one of OpenCV's, such as DICT_5X5_100 or DICT_4X4_50"
    return f"did you mean {', '.join(close[:-1])}{' or ' if close[1:] else ''}{close[-1]}?"


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
