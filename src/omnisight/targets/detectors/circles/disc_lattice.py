"""Join discs into the lattice of a grid, and find its positions on the board.

The nearest neighbour of a disc is as far away as three more, a quarter turn apart: the grid is a square lattice, which
stands on its corner if every second row is shifted. A disc's ellipse is what the lens locally makes of a circle, so
quarter turns and equal distances can be recognized in every image, however flat the ellipse.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnisight.targets.boards.circles import CircleGrid
from omnisight.targets.detection_limits import SEARCH_RADIUS_STEPS
from omnisight.targets.detectors.circles.blobs import Blobs
from omnisight.targets.subpixel.local_map import NUM_ANCHORS

Array = NDArray[np.float64]
Cells = NDArray[np.int64]

# Distance between the centres of neighbouring discs, in radii: they do not touch, nor are they points.
MIN_STEP_RADII, MAX_STEP_RADII = 1.35, 8.0
# Ratio of the areas of two neighbours.
MAX_AREA_RATIO = 2.5
# Seeds that are tried, and discs of a lattice at least.
MAX_SEEDS, MIN_DISCS = 60, 6

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
NEIGHBOURS = ((1, 0), (0, 1), (-1, 0), (0, -1))


class DiscLattice(NamedTuple):
    """Discs of one grid: which blobs (N,), and their cells (N, 2), as counts of the two steps.

    The second step is clockwise of the first, as seen.
    """

    blobs: NDArray[np.int64]
    cells: Cells


class BoardPosition(NamedTuple):
    """A position of a lattice on a board: the id of each disc, -1 off the board, and the number of contradictions."""

    ids: NDArray[np.int64]
    contradictions: int


def grow_lattices(blobs: Blobs) -> Iterator[DiscLattice]:
    """Join blobs into disjoint lattices, starting from the most regular neighbourhoods."""
    if len(blobs.centres) >= MIN_DISCS:
        grower = _Grower(blobs)
        for seed, step in grower.seeds():
            if grower.free[seed] and grower.tried < MAX_SEEDS and (lattice := grower.grow(seed, step)) is not None:
                yield lattice


class _Grower:
    """State of the growth: the blobs that are not part of a lattice yet."""

    def __init__(self, blobs: Blobs) -> None:
        from scipy.spatial import KDTree  # imported on use: scipy is slow to import

        self.centres, self.matrices = blobs
        self.tree = KDTree(blobs.centres)
        self.whitening: Array = np.linalg.inv(blobs.matrices).astype(np.float64)
        self.area: Array = np.linalg.det(blobs.matrices).astype(np.float64)
        self.free = np.ones(len(blobs.centres), bool)
        self.tried = 0

    def seeds(self) -> list[tuple[int, Array]]:
        """Return the blobs with four neighbours a quarter turn apart, and their first steps in radii."""
        count = len(self.centres)
        near = np.asarray(self.tree.query(self.centres, k=min(NUM_ANCHORS + 1, count))[1])[:, 1:]
        white = np.einsum("nab,nkb->nka", self.whitening, self.centres[near] - self.centres[:, None])
        distance = np.linalg.norm(white, axis=2)
        ratio = self.area[near] / self.area[:, None]
        usable = (ratio < MAX_AREA_RATIO) & (ratio > 1 / MAX_AREA_RATIO)
        usable &= (distance > MIN_STEP_RADII) & (distance < MAX_STEP_RADII)
        distance = np.where(usable, distance, np.inf)
        step = white[np.arange(count), np.argmin(distance, axis=1)]
        around = np.stack([step, step @ QUARTER_TURN.T, -step, -step @ QUARTER_TURN.T], axis=1)
        with np.errstate(invalid="ignore"):
            deviation = np.linalg.norm(white[:, None] - around[:, :, None], axis=3)
            deviation = np.where(usable[:, None], deviation, np.inf).min(axis=2)
            deviation /= np.linalg.norm(step, axis=1)[:, None]
        seeds = np.flatnonzero((deviation < SEARCH_RADIUS_STEPS).all(axis=1) & np.isfinite(distance.min(axis=1)))
        return [(int(seed), step[seed]) for seed in seeds[np.argsort(deviation[seeds].sum(axis=1))]]

    def grow(self, seed: int, step: Array) -> DiscLattice | None:
        """Grow a lattice from one blob; None, with all its blobs free again, if it stays small."""
        self.tried += 1
        table = {(0, 0): seed}
        self.free[seed] = False
        queue = deque([(0, 0)])
        turned = QUARTER_TURN @ step
        first = self.matrices[seed] @ np.stack([step, turned, -step, -turned], axis=1)
        while queue:
            i, j = queue.popleft()
            for k, (di, dj) in enumerate(NEIGHBOURS):
                if (i + di, j + dj) in table:
                    continue
                predicted = self._predict(table, i, j, di, dj)
                if predicted is None and table[i, j] == seed:
                    predicted = self.centres[seed] + first[:, k]
                nearest = None if predicted is None else self._nearest(table[i, j], predicted)
                if nearest is not None:
                    table[i + di, j + dj] = nearest
                    self.free[nearest] = False
                    queue.append((i + di, j + dj))
        members = np.array(list(table.values()), np.int64)
        if len(members) < MIN_DISCS:
            self.free[members] = True
            return None
        return DiscLattice(members, np.array(list(table), np.int64))

    def _nearest(self, here: int, predicted: Array) -> int | None:
        """Return the free blob of similar area nearest to the predicted neighbour of a disc, if it is in range."""
        step = predicted - self.centres[here]
        whitening = self.whitening[here]
        near = [
            (float(np.linalg.norm(whitening @ (self.centres[b] - predicted))), b)
            for b in self.tree.query_ball_point(predicted, np.linalg.norm(step) * SEARCH_RADIUS_STEPS * 2)
            if self.free[b] and 1 / MAX_AREA_RATIO < self.area[b] / self.area[here] < MAX_AREA_RATIO
        ]
        if not near or min(near)[0] >= SEARCH_RADIUS_STEPS * np.linalg.norm(whitening @ step):
            return None
        return min(near)[1]

    def _predict(self, table: dict[tuple[int, int], int], i: int, j: int, di: int, dj: int) -> Array | None:
        """Predict the next disc: extrapolate this line, or copy the step from the line beside it."""
        centres = self.centres
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


def board_positions(cells: Cells, empty: Cells, board: CircleGrid, *, mirrored: bool) -> list[BoardPosition]:
    """Return the most likely positions of a lattice on a grid.

    With x and y in spacings, the discs of staggered rows are where x + y is even in the rectangle of 2 columns by rows;
    those of straight rows are everywhere in columns by rows. Staggered rows, rotated by 180°,
    that is itself if the number of rows is even; mirrored top to bottom, if it is odd: then a mirror image cannot be
    recognized, and is taken as none.

    Parameters
    ----------
    cells : (N, 2) array of int
        The discs.
    empty : (M, 2) array of int
        Where paper is seen, but no disc.
    board : CircleGrid
    mirrored : bool
        Whether the image is taken as a mirror image.

    Returns
    -------
    list of BoardPosition
        All positions with the least contradictions: discs off the board, and its discs where there is paper.
    """
    best, min_contradictions = list[BoardPosition](), len(cells)
    columns = 2 * board.columns if board.is_staggered else board.columns
    for quarters in range(4):
        discs, paper = (_in_spacings(c, board, quarters, mirrored) for c in (cells, empty))
        low, high = discs.min(axis=0), discs.max(axis=0)
        # At most a third may be off the board on any side; more cannot be its discs.
        slack = (high - low) // 3 + 1
        for x in range(-low[0] - slack[0], columns - high[0] + slack[0]):
            for y in range(-low[1] - slack[1], board.rows - high[1] + slack[1]):
                if board.is_staggered and (x + y) % 2:
                    continue
                ids = _ids(discs + np.array([x, y]), board)
                contradictions = int((ids < 0).sum() + (_ids(paper + np.array([x, y]), board) >= 0).sum())
                if contradictions < min_contradictions:
                    best, min_contradictions = [], contradictions
                if contradictions == min_contradictions:
                    best.append(BoardPosition(ids, contradictions))
    return best


def _in_spacings(cells: Cells, board: CircleGrid, quarters: int, mirrored: bool) -> Cells:
    """Return x and y (N, 2) in spacings of cells, relative to cell (0, 0), after some quarter turns."""
    x, y = cells.T
    if board.is_staggered:
        x, y = x - y, x + y
    if mirrored:
        x = -x
    for _ in range(quarters):
        x, y = -y, x
    return np.stack([x, y], axis=1)


def _ids(cells: Cells, board: CircleGrid) -> Cells:
    x, y = cells.T
    steps = 2 if board.is_staggered else 1
    inside = (x >= 0) & (x < steps * board.columns) & (y >= 0) & (y < board.rows)
    return np.where(inside, y * board.columns + x // steps, -1)
