"""Edges that stand still from picture to picture: each is told once."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from omnisight.calibrate.lines.chains import Chains

# Pixels of an arc that are looked at, how near (px) another arc's must be, and the share of them that is.
PIXELS = 24
NEAR = 1.5
SHARE = 0.7


def seen_before(arcs: Chains) -> NDArray[np.intp]:
    """Say of each arc (A,) which one tells it already: one of another picture that lies where it does; -1 for none.

    A camera that stands still sees an edge of the room at the same place in every picture. What is wrong with that
    edge is wrong with it every time, so that the number of pictures would make a false line certain. The longest of
    such arcs is kept.
    """
    order = np.argsort(-arcs.spans, kind="stable")
    rank = np.empty(len(arcs), np.intp)
    rank[order] = np.arange(len(arcs))
    told = np.full(len(arcs), -1, np.intp)
    if len(np.unique(arcs.pictures)) < 2:
        return told
    few = arcs.thinned(PIXELS)
    owner = arcs.chain_of_row
    tree = KDTree(arcs.pixels)
    for arc in order:
        near = tree.query_ball_point(few.pixels[few.groups[arc]], NEAR)
        found = [np.unique(owner[rows]) for rows in near]
        others, hits = np.unique(np.concatenate(found), return_counts=True)
        kept = (told[others] < 0) & (rank[others] < rank[arc]) & (arcs.pictures[others] != arcs.pictures[arc])
        others, hits = others[kept], hits[kept]
        if len(hits) and hits.max() >= SHARE * len(found):
            told[arc] = others[np.argmax(hits)]
    return told
