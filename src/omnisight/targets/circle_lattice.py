"""Joins discs into the lattice of an asymmetric grid, and finds where that lies on the board.

The disc nearest to another is a diagonal step away, and so are three more, each a quarter turn on: the grid is a square
lattice that stands on its corner. A disc's ellipse says what the lens makes of a circle there, so quarter turns and
equal distances can be told in every image, however flat the ellipse.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from .blobs import Blobs

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

_NEAREST = 20
_APART = (1.35, 8.0)
"""Distance of two neighbouring discs' middles in radii: they do not touch, nor are they points."""

_REACH = 0.33
"""How far from its predicted place the next disc may be, over the step to there."""

_UNLIKE = 2.5
"""Greatest ratio of the areas of two neighbours."""

_SEEDS = 60
_LEAST = 6
_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
_STEPS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])


class Lattice(NamedTuple):
    """Discs of one grid: which blobs (N,), and their cells (N, 2), as counts of the two diagonal steps.

    The second step is clockwise of the first, as seen.
    """

    blobs: NDArray[np.int64]
    cells: Cells


def grow_lattices(blobs: Blobs) -> Iterator[Lattice]:
    """Join blobs into lattices; none has a blob of another."""
    count = len(blobs.centres)
    if count < _LEAST:
        return
    tree = KDTree(blobs.centres)
    inverse: Array = np.linalg.inv(blobs.matrices).astype(np.float64)
    area: Array = np.linalg.det(blobs.matrices).astype(np.float64)
    near = np.asarray(tree.query(blobs.centres, k=min(_NEAREST + 1, count))[1])[:, 1:]
    white = np.einsum("nab,nkb->nka", inverse, blobs.centres[near] - blobs.centres[:, None])
    away = np.linalg.norm(white, axis=2)
    alike = (area[near] < _UNLIKE * area[:, None]) & (area[near] * _UNLIKE > area[:, None])
    usable = alike & (away > _APART[0]) & (away < _APART[1])
    away = np.where(usable, away, np.inf)
    first = np.argmin(away, axis=1)
    step = white[np.arange(count), first]
    around = np.stack([step, step @ _TURN.T, -step, -step @ _TURN.T], axis=1)
    with np.errstate(invalid="ignore"):
        apart = np.linalg.norm(white[:, None] - around[:, :, None], axis=3)
        apart = np.where(usable[:, None], apart, np.inf).min(axis=2) / np.linalg.norm(step, axis=1)[:, None]
    seeds = np.flatnonzero(((apart < _REACH).sum(axis=1) == 4) & np.isfinite(away.min(axis=1)))
    free = np.ones(count, bool)
    tried = 0
    for seed in seeds[np.argsort(apart[seeds].sum(axis=1))].tolist():
        if free[seed] and tried < _SEEDS:
            tried += 1
            lattice = _grown(seed, step[seed], blobs, tree, inverse, area, free)
            if len(lattice.blobs) >= _LEAST:
                yield lattice
            else:
                free[lattice.blobs] = True


def _grown(
    seed: int, step: Array, blobs: Blobs, tree: KDTree, inverse: Array, area: Array, free: NDArray[np.bool_]
) -> Lattice:
    """Grow a lattice from one blob, given the first step in radii; takes its blobs out of `free`."""
    centres, matrices = blobs.centres, blobs.matrices
    table = {(0, 0): seed}
    free[seed] = False
    queue = deque([(0, 0)])
    first = matrices[seed] @ np.stack([step, _TURN @ step, -step, -_TURN @ step], axis=1)
    while queue:
        i, j = queue.popleft()
        here = table[i, j]
        for k, (di, dj) in enumerate(_STEPS.tolist()):
            if (i + di, j + dj) in table:
                continue
            place = _predicted(table, centres, i, j, di, dj)
            if place is None:
                if here != seed:
                    continue
                place = centres[seed] + first[:, k]
            length = np.linalg.norm(inverse[here] @ (place - centres[here]))
            radius = np.linalg.norm(place - centres[here]) * _REACH * 2
            found = [
                (float(np.linalg.norm(inverse[here] @ (centres[b] - place))), b)
                for b in tree.query_ball_point(place, radius)
                if free[b] and 1 / _UNLIKE < area[b] / area[here] < _UNLIKE
            ]
            if found and min(found)[0] < _REACH * length:
                table[i + di, j + dj] = min(found)[1]
                free[min(found)[1]] = False
                queue.append((i + di, j + dj))
    return Lattice(np.array(list(table.values()), np.int64), np.array(list(table), np.int64))


def _predicted(table: dict[tuple[int, int], int], centres: Array, i: int, j: int, di: int, dj: int) -> Array | None:
    """Guess where the next disc is: continue this line, or copy the step from the lines beside it.

    As `_predict` of `grids/_growth_kernel.py`, which is compiled, for a table that is an array: this one is a dict.
    """
    here = centres[table[i, j]]
    if (i - di, j - dj) in table:
        behind = centres[table[i - di, j - dj]]
        further = table.get((i - 2 * di, j - 2 * dj))
        bend = 0.0 if further is None else here - 2 * behind + centres[further]
        return 2 * here - behind + bend
    for side in (1, -1):
        beside, ahead = (i + side * dj, j + side * di), (i + side * dj + di, j + side * di + dj)
        if beside in table and ahead in table:
            return here + centres[table[ahead]] - centres[table[beside]]
    return None


class Place(NamedTuple):
    """Where a lattice may lie on a board: the id of each of its discs, -1 off the board, and what speaks against it."""

    ids: NDArray[np.int64]
    against: int


def places(cells: Cells, empty: Cells, columns: int, rows: int, *, mirrored: bool) -> list[Place]:
    """Give the likeliest places of a lattice on an asymmetric grid.

    With x and y in spacings, the discs are where x + y is even in the rectangle of 2 columns by rows. Turned by half,
    that is itself if the rows are even in number; mirrored top to bottom, if they are odd. So an image of the latter
    does not tell whether it is a mirror image, and is taken as none.

    Parameters
    ----------
    cells : (N, 2) array of int
        The discs.
    empty : (M, 2) array of int
        Where paper is seen, but no disc.
    columns, rows : int
    mirrored : bool
        Whether the image is taken as a mirror image.

    Returns
    -------
    list of Place
        All those against which least speaks: discs off the board, and its discs where there is paper.
    """
    found, least = list[Place](), len(cells)
    for quarter in range(4):
        at, paper = (_on_board(c, quarter, mirrored) for c in (cells, empty))
        low, high = at.min(axis=0), at.max(axis=0)
        # At most a third may be off the board on any side; more cannot be its discs.
        slack = (high - low) // 3 + 1
        for x in range(-low[0] - slack[0], 2 * columns - high[0] + slack[0]):
            for y in range(-low[1] - slack[1], rows - high[1] + slack[1]):
                if (x + y) % 2:
                    continue
                ids = _ids(at + np.array([x, y]), columns, rows)
                against = int((ids < 0).sum() + (_ids(paper + np.array([x, y]), columns, rows) >= 0).sum())
                if against <= least:
                    found = [place for place in found if against == least] + [Place(ids, against)]
                    least = against
    return found


def _on_board(cells: Cells, quarter: int, mirrored: bool) -> Cells:
    """Give x and y (N, 2) in spacings of cells, after some quarter turns, from one of the discs."""
    x, y = cells[:, 0] - cells[:, 1], cells[:, 0] + cells[:, 1]
    if mirrored:
        x = -x
    for _ in range(quarter):
        x, y = -y, x
    return np.stack([x, y], axis=1)


def _ids(at: Cells, columns: int, rows: int) -> Cells:
    x, y = at.T
    inside = (x >= 0) & (x < 2 * columns) & (y >= 0) & (y < rows)
    return np.where(inside, y * columns + x // 2, -1)
