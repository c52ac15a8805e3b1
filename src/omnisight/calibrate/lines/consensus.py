"""Which arcs are images of straight lines: those that one camera explains together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.calibrate.freedom import Freedom
from omnisight.calibrate.lines.chains import Chains
from omnisight.calibrate.lines.circles import fit_circle
from omnisight.calibrate.lines.plumb import Lines, line_sigma, lines_of, refine_lines
from omnisight.calibrate.lines.start import chain_rms, plausible, starts
from omnisight.models import CameraModel
from omnisight.models.unified import Unified

Array = NDArray[np.float64]

# Cameras of the search that are refined.
TRIED = 4
# Of the arcs as many, the longest, and of each as many pixels, are enough to search with.
ENOUGH = 120
PIXELS = 24
# The rms distances (px) up to which an arc counts as a line, one after another.
NARROWING = (3.0, 2.0, 1.5, 1.2)
# px that an arc may lie off its line at most, bends of all kinds together.
MOST_OFF = 1.5
# An arc that is bent otherwise than its line by more than so many times what is usual is none; by so many standard
# deviations at least, as noise would have it (pixels next to each other share theirs), and by so many px.
BENT, CHANCE, LEAST_BENT = 2.0, 5.0, 0.04
# The angle (radians) that a line spans at least, where so many do: what is shorter hardly bends, be it a line or not.
LONG, ENOUGH_LONG = np.radians(12.0), 12
# The angle (radians) to the great circle of another arc past which none of its line is looked for.
FAR = np.radians(4.0)
# The gap to what is joined, in lengths of the arc: it tells where its line goes about so far.
GAP = 2.0
# Lines that a camera is determined by.
FEWEST = 3


@dataclass(frozen=True)
class Consensus:
    """The lines that a camera explains.

    Attributes
    ----------
    state
        The camera, and the plane of each line.
    chains
        The lines; arcs of one line are joined.
    line_of_arc
        (A,) the line that each of the arcs belongs to, -1 for none.
    """

    state: Lines
    chains: Chains
    line_of_arc: NDArray[np.intp]


def find_lines(
    arcs: Chains,
    size: tuple[int, int],
    centre: Array,
    *,
    known: Mapping[str, float],
    square: bool = True,
    trusted: bool = False,
    seed: int = 0,
) -> Consensus:
    """Find the camera of the unified model that explains most, and the arcs that are images of lines.

    The likeliest cameras of `starts` are refined on the arcs that they explain, ever more strictly, and the one is kept
    that leaves the least unexplained.

    Parameters
    ----------
    arcs
        Images of lines, and of others.
    size
        (width, height) px.
    centre
        (2,) where the principal point is expected.
    known
        Parameters of the unified model that are known, by name.
    square
        Pixels are square: fx = fy.
    trusted
        Every arc is a line: none is left out, none joined.
    seed
        Of the search.

    Raises
    ------
    ValueError
        If no camera explains three of them.
    """
    longest = np.argsort(-arcs.spans, kind="stable")[:ENOUGH]
    few = arcs.subset(longest).thinned(PIXELS)
    best: Lines | None = None
    least = np.inf
    for start in _apart(starts(few, size, centre, known=known, seed=seed)):
        freedom = Freedom.of(start, square=square, fixed=tuple(known))
        state = _narrowed(start, few, freedom, trusted)
        if state is None or not plausible(state.model, size, centre):
            continue
        rms = chain_rms(lines_of(state.model, few).distances(few), few)
        left = float((few.spans * np.minimum(rms / MOST_OFF, 1.0) ** 2).sum())
        if left < least:
            best, least = state, left
    if best is None:
        raise ValueError(
            f"no camera explains {FEWEST} of {len(arcs)} lines: are they images of straight lines, and long enough to"
            " be bent by the lens or mirror?"
        )
    return select(best.model, arcs, trusted=trusted)


def select(model: CameraModel, arcs: Chains, *, trusted: bool = False, joined: bool = False) -> Consensus:
    """Say which arcs are lines to a camera.

    If asked to, arcs of one picture that lie on one great circle are joined: a line that something stands before is
    told by all its parts.
    """
    state = lines_of(model, arcs)
    chosen = np.arange(len(arcs)) if trusted else np.flatnonzero(_explained(state, arcs))
    line = np.full(len(arcs), -1, np.intp)
    if trusted:
        line[:] = np.arange(len(arcs))
        return Consensus(state, arcs, line)
    lines = _joined(model, arcs, chosen) if joined else [[int(i)] for i in chosen]
    chains = Chains.of(
        [np.concatenate([arcs.pixels[arcs.groups[k]] for k in members]) for members in lines],
        [int(arcs.pictures[members[0]]) for members in lines],
    )
    state = lines_of(model, chains)
    long = state.extents(chains) > LONG
    if long.sum() >= ENOUGH_LONG:
        chains, lines = chains.subset(np.flatnonzero(long)), [lines[i] for i in np.flatnonzero(long)]
        state = Lines(model, state.normals[long])
    for i, members in enumerate(lines):
        line[members] = i
    return Consensus(state, chains, line)


def _explained(state: Lines, arcs: Chains) -> NDArray[np.bool_]:
    """Say which arcs are bent as lines are (L,).

    What a circle, which bends as it likes, explains of an arc and its great circle does not is its bend. An arc that
    wanders to both sides is a rough edge; one that bends to one side is no line. Long arcs say what is usual: it is
    what the model does not describe.
    """
    rms = chain_rms(state.distances(arcs), arcs)
    free = np.array([np.sqrt((fit_circle(arc).distance(arc) ** 2).mean()) for arc in arcs.each()])
    bend = np.sqrt(np.maximum(rms**2 - free**2, 0.0))
    clear = rms < MOST_OFF
    if not clear.any():
        return clear
    order = np.argsort(bend)
    weight = np.cumsum(np.where(clear, arcs.spans**2, 0.0)[order])
    usual = float(bend[order][np.searchsorted(weight, weight[-1] / 2)])
    chance = CHANCE * free / np.sqrt(arcs.counts)
    return clear & (bend < np.maximum(np.maximum(BENT * usual, LEAST_BENT), chance))


def _apart(cameras: list[Unified]) -> list[Unified]:
    """Give the first cameras, but none that is nearly another: they would end at the same place."""
    kept: list[Unified] = []
    for camera in cameras:
        near = (
            other
            for other in kept
            if abs(camera.xi - other.xi) < 0.25
            and np.hypot(camera.cx - other.cx, camera.cy - other.cy) < 0.15 * other.fx
            and abs(np.log(camera.fx / other.fx)) < 0.25
        )
        if next(near, None) is None:
            kept.append(camera)
        if len(kept) == TRIED:
            break
    return kept


def _narrowed(start: Unified, arcs: Chains, freedom: Freedom, trusted: bool) -> Lines | None:
    """Refine a camera on what it explains, ever more strictly; None where that is less than three lines."""
    model: CameraModel = start
    state: Lines | None = None
    # Lines that are all true need no second choice, but few of them have more than one minimum: go to its bottom.
    for limit in NARROWING[:1] if trusted else NARROWING:
        fitted = lines_of(model, arcs)
        rms = chain_rms(fitted.distances(arcs), arcs)
        chosen = np.arange(len(arcs)) if trusted else np.flatnonzero(rms < limit)
        if len(chosen) < FEWEST:
            return None
        part = arcs.subset(chosen)
        steps, tolerance = (40, 1e-7) if trusted else (10, 1e-3)
        begun = Lines(model, fitted.normals[chosen])
        state = refine_lines(begun, part, freedom, iterations=steps, tolerance=tolerance).state
        model = state.model
    return state


def _joined(model: CameraModel, arcs: Chains, chosen: NDArray[np.intp]) -> list[list[int]]:
    """Group arcs of one picture that one great circle explains as well as each has its own, the longest first."""
    few = arcs.thinned(PIXELS)
    single = lines_of(model, few)
    alone = chain_rms(single.distances(few), few)
    sigma = line_sigma(Lines(model, single.normals[chosen]), few.subset(chosen)) if len(chosen) else 0.0
    bearings = np.nan_to_num(model.unproject_numpy(few.pixels)[0])
    groups: list[list[int]] = []
    normals: list[Array] = []
    for arc in chosen[np.argsort(-arcs.spans[chosen], kind="stable")]:
        pixels = few.pixels[few.groups[arc]]
        home = -1
        for k, members in enumerate(groups):
            if arcs.pictures[members[0]] != arcs.pictures[arc] or abs(normals[k] @ single.normals[arc]) < 0.9:
                continue
            # Far off already as it lies: no need to fit.
            here = bearings[few.groups[arc]]
            if np.abs(here @ normals[k]).max() > FAR:
                continue
            there = np.concatenate([bearings[few.groups[m]] for m in members])
            length, gap = (float(np.arccos(np.clip(c, -1, 1))) for c in (here[0] @ here[-1], (here @ there.T).max()))
            if gap > GAP * length:
                continue
            both = Chains.of([np.concatenate([few.pixels[few.groups[m]] for m in members] + [pixels])])
            joint = lines_of(model, both)
            off = joint.distances(both)
            each = [*(alone[m] for m in members), alone[arc]]
            tail = np.sqrt((off[-len(pixels) :] ** 2).mean())
            if tail < max(1.3 * alone[arc], sigma) and np.sqrt((off**2).mean()) < max(1.3 * max(each), sigma):
                home = k
                normals[k] = joint.normals[0]
                break
        if home < 0:
            groups.append([int(arc)])
            normals.append(single.normals[arc])
        else:
            groups[home].append(int(arc))
    return groups
